//! `quadrille studio`: from a folder of images to results, in a browser.

mod desk;
mod folder;
mod gauges;
mod job;
mod server;

use crate::cli::about::devices;
use crate::cli::args::StudioArgs;
use crate::cli::{Outcome, Result, signals};
use crate::run::Request;
use desk::Studied;
use folder::is_inside;
use job::Job;
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

pub(super) fn run(args: &StudioArgs) -> Result<Outcome> {
    let given = &args.folder;
    let folder = given.canonicalize().map_err(|error| format!("{}: cannot be opened: {error}", given.display()))?;
    if !folder.is_dir() {
        return Err(format!("{}: this is not a folder; name the one with the images", given.display()).into());
    }
    let within = |name: &Path, flag: &str| {
        let plain = name.components().count() == 1 && name.file_name().is_some();
        let words = "it has to be a plain name: it lies in the folder of the images";
        if !plain {
            return Err(format!("{flag} {}: {words}", name.display()));
        }
        let path = folder.join(name);
        // A link of that name may lead anywhere, also one to nothing yet.
        if path.is_symlink() && !is_inside(&folder, &path) {
            return Err(format!("{flag} {}: is a link that leads out of the folder; remove it", name.display()));
        }
        Ok(path)
    };
    let studied = Studied {
        case: within(&args.case, "--case")?,
        output: within(&args.output, "--output")?,
        asked: Request { device: args.device.clone(), gpu: devices::options(false), ..Request::default() },
        threads: args.threads,
        pool: Arc::new(args.threads.pool()?),
        job: Arc::new(Job::default()),
        folder: folder.clone(),
    };
    let port = args.port;
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(|error| {
        format!("port {port} of this machine cannot be opened: {error}; choose another with --port")
    })?;
    let port = listener.local_addr()?.port();
    let token = format!("{:032x}", rand::random::<u128>());
    let address = format!("http://127.0.0.1:{port}/{token}/");
    // What a program that starts this one waits for.
    println!("{address}");
    if !args.talk.quiet {
        eprintln!("{}: open this address in a browser; Ctrl-C ends it", folder.display());
        eprintln!("from another machine: ssh -L {port}:127.0.0.1:{port} THIS-MACHINE, then the same address there");
        eprintln!("whoever has the address can start and stop runs in this folder: keep it to yourself");
    }
    let stop = signals::listen()?;
    let job = Arc::clone(&studied.job);
    server::serve(&listener, &token, move |asked| studied.answer(asked), || !stop.is_asked())?;
    job.stop();
    // What is on the device is finished.
    while job.is_running() {
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(Outcome::Fine)
}
