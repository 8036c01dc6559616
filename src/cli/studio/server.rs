//! Requests of a browser on this machine, each on a thread of its own, and who may make them.
//!
//! Only addresses that begin with the token are answered, only under a name of this machine, and never on behalf of a
//! page that came from elsewhere.

use http_body_util::{BodyExt, Full, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    CACHE_CONTROL, CONTENT_TYPE, HOST, HeaderMap, HeaderName, HeaderValue, ORIGIN, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use hyper::rt::ReadBufCursor;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use std::convert::Infallible;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

const MOST_BYTES: usize = 4 << 20;
const MOST_AT_ONCE: usize = 64;
/// How long an answer may take to leave.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long a request may take to arrive as a whole; and where more than half of all places are taken.
const ARRIVAL: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(1)];
/// How often is looked whether to go on.
const EVERY: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(super) struct Asked {
    /// What comes behind the token.
    pub path: String,
    /// What comes behind `?`.
    pub query: String,
    /// Whether something is to be done, and not only shown.
    pub is_post: bool,
    /// What came with it.
    pub body: Bytes,
}

impl Asked {
    /// The whole number that the query has for `key`.
    pub fn number(&self, key: &str) -> Option<usize> {
        self.query.split('&').find_map(|part| part.strip_prefix(key)?.strip_prefix('=')?.parse().ok())
    }
}

#[derive(Debug)]
pub(super) struct Answer {
    pub status: StatusCode,
    pub kind: &'static str,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn html(page: String) -> Self {
        Self { status: StatusCode::OK, kind: "text/html; charset=utf-8", body: page.into_bytes() }
    }

    pub fn json(value: &serde_json::Value) -> Self {
        Self { status: StatusCode::OK, kind: "application/json", body: value.to_string().into_bytes() }
    }

    /// Something that does not work, in words.
    pub fn refused(status: StatusCode, words: impl Into<String>) -> Self {
        Self { status, kind: "text/plain; charset=utf-8", body: words.into().into_bytes() }
    }
}

/// Has `answer` what may be asked until `on` says no.
pub(super) fn serve(
    listener: &TcpListener,
    token: &str,
    answer: impl Fn(&Asked) -> Answer + Send + Sync + 'static,
    on: impl Fn() -> bool,
) -> io::Result<()> {
    listener.set_nonblocking(true)?;
    let (token, answer): (Arc<str>, _) = (token.into(), Arc::new(answer));
    let at_once = Arc::new(AtomicUsize::new(0));
    while on() {
        let stream = match listener.accept() {
            Ok((stream, _)) => stream,
            Err(_) => {
                std::thread::sleep(EVERY);
                continue;
            }
        };
        let n_before = at_once.fetch_add(1, Ordering::SeqCst);
        if n_before >= MOST_AT_ONCE {
            at_once.fetch_sub(1, Ordering::SeqCst);
            continue;
        }
        let [usual, crowded] = ARRIVAL;
        let patience = if n_before > MOST_AT_ONCE / 2 { crowded } else { usual };
        let (token, answer, at_once) = (Arc::clone(&token), Arc::clone(&answer), Arc::clone(&at_once));
        std::thread::spawn(move || {
            // A browser that goes away is no matter.
            let _ = answer_one(stream, patience, &token, &*answer);
            at_once.fetch_sub(1, Ordering::SeqCst);
        });
    }
    Ok(())
}

/// Answers the one request of a connection, which has arrived within `patience`.
fn answer_one(
    stream: TcpStream,
    patience: Duration,
    token: &str,
    answer: &impl Fn(&Asked) -> Answer,
) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    stream.set_nodelay(true)?;
    let service = service_fn(|request| async { Ok::<_, Infallible>(response(checked(request, token, answer).await)) });
    // With half closed connections allowed nothing is read while an answer is made: reading waits here.
    let connection = http1::Builder::new()
        .keep_alive(false)
        .half_close(true)
        .serve_connection(Blocking::new(stream, patience), service);
    pollster::block_on(connection).map_err(io::Error::other)
}

/// What `answer` says to a request that may be made.
async fn checked(request: Request<Incoming>, token: &str, answer: &impl Fn(&Asked) -> Answer) -> Answer {
    let is_post = request.method() == Method::POST;
    if !is_post && request.method() != Method::GET {
        return Answer::refused(StatusCode::METHOD_NOT_ALLOWED, "only GET and POST are answered");
    }
    if let Some(why) = foreign(request.headers(), is_post) {
        return Answer::refused(StatusCode::FORBIDDEN, why);
    }
    let behind = request.uri().path().strip_prefix('/').and_then(|path| path.split_once('/'));
    let Some((_, path)) = behind.filter(|(given, _)| same(given, token)) else {
        return Answer::refused(StatusCode::NOT_FOUND, "this is not the address that `quadrille studio` has printed");
    };
    let (path, query) = (path.to_owned(), request.uri().query().unwrap_or_default().to_owned());
    match Limited::new(request.into_body(), MOST_BYTES).collect().await {
        Ok(body) => answer(&Asked { path, query, is_post, body: body.to_bytes() }),
        Err(_) => Answer::refused(StatusCode::PAYLOAD_TOO_LARGE, "this is more than a case file can be"),
    }
}

/// Why a request is not answered: it came under another name than this machine's, or on behalf of another page.
fn foreign(headers: &HeaderMap, is_post: bool) -> Option<&'static str> {
    let text = |value: Option<&HeaderValue>| value.and_then(|value| value.to_str().ok()).map(str::to_owned);
    let host = text(headers.get(HOST)).filter(|_| headers.get_all(HOST).iter().count() == 1).unwrap_or_default();
    let name = host.rsplit_once(':').map_or(&*host, |(name, port)| if port.parse::<u16>().is_ok() { name } else { "" });
    if !["127.0.0.1", "localhost", "[::1]"].contains(&name) {
        return Some("only 127.0.0.1 and localhost are answered: forward a port to them");
    }
    let origin = headers.get(ORIGIN);
    let own = format!("http://{host}");
    if origin.is_some() && text(origin).as_deref() != Some(&*own) || is_post && origin.is_none() {
        return Some("this came from another page");
    }
    let site = text(headers.get("sec-fetch-site"));
    site.filter(|site| site != "same-origin" && site != "none").map(|_| "this came from another page")
}

/// Whether two texts are the same, in a time that does not tell where they differ.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

fn response(answer: Answer) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(Bytes::from(answer.body)));
    *response.status_mut() = answer.status;
    let said = [
        (CONTENT_TYPE, answer.kind),
        (CACHE_CONTROL, "no-store"),
        (REFERRER_POLICY, "no-referrer"),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (X_FRAME_OPTIONS, "SAMEORIGIN"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ];
    for (name, value) in said {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// A connection of which reading and writing wait: its thread has nothing else to do.
struct Blocking {
    stream: TcpStream,
    /// When all of the request has to be there.
    until: Instant,
}

impl Blocking {
    fn new(stream: TcpStream, patience: Duration) -> Self {
        Self { stream, until: Instant::now() + patience }
    }

    /// Reads what is there, and waits no longer than until the end: a byte now and then keeps no place.
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(room)
    }
}

impl hyper::rt::Read for Blocking {
    fn poll_read(mut self: Pin<&mut Self>, _: &mut Context<'_>, mut into: ReadBufCursor<'_>) -> Poll<io::Result<()>> {
        let mut room = [0; 8192];
        let most = room.len().min(into.remaining());
        Poll::Ready(self.read(&mut room[..most]).map(|n| into.put_slice(&room[..n])))
    }
}

impl hyper::rt::Write for Blocking {
    fn poll_write(mut self: Pin<&mut Self>, _: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Poll::Ready(self.stream.write(bytes))
    }

    fn poll_flush(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(self.stream.flush())
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        // Whoever is gone already needs no end.
        let _ = self.stream.shutdown(std::net::Shutdown::Write);
        Poll::Ready(Ok(()))
    }
}
