//! Image files: read in their native depth, written as TIFF or PNG.

mod film;
mod foreign;
mod packed;
mod pfm;
pub(super) mod raw;
pub(super) mod upright;
mod write;

pub use foreign::Foreign;
pub use raw::Accepted;
pub use write::{WriteError, png_bytes, write_image};

use super::tiff::{self as tiff_pages, Bytes, LargeFile};
pub use crate::digest::sha256_hex as sha256;
use crate::imaging::{Image, ImageError, Levels};
use crate::text::{check_regular, read_regular};
use film::Film;
use image::ImageFormat;
use packed::decode;
use raw::{ImageFault, Raw};
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// An image and what is worth knowing about its file.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The grey levels, in the depth of the file.
    pub image: Image,
    /// What a user should know: colours made grey, more pages, an ignored alpha channel. Often empty.
    pub notes: Vec<String>,
    /// SHA-256 of the file, in hexadecimal; of a video or a stack too large to be read as a whole, that of the grey levels.
    pub sha256: String,
    /// Number of pages in the file.
    pub pages: usize,
    /// The largest grey level that the file can hold, in the scale of the image; 1 for a file of floats.
    pub white: f32,
    /// When it was taken by the camera's clock, `2024-05-01T10:11:12.25`, where the file says so (EXIF, TIFF page).
    pub taken: Option<String>,
    /// Seconds since the first frame of its video, where that says so.
    pub time_s: Option<f64>,
}

/// Why a file gives no image.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReadError {
    /// There is no such file.
    #[error("{}: there is no such file; check the name and the folder", .0.display())]
    NotFound(PathBuf),
    /// It is a folder.
    #[error("{}: this is a folder; name an image file in it", .0.display())]
    Directory(PathBuf),
    /// The file system refuses.
    #[error("{}: cannot be read: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
    /// The file has no bytes.
    #[error("{}: the file is empty; copy it again from where it was recorded", .0.display())]
    Empty(PathBuf),
    /// A file that is being written has not come to rest.
    #[error("{}: the file goes on changing; give its images names of their own", .0.display())]
    Changing(PathBuf),
    /// The content is no image of a known format.
    #[error("{}: not an image: the content begins with {begins}; use TIFF, PNG, BMP, JPEG or PGM", path.display())]
    NotAnImage {
        /// The file.
        path: PathBuf,
        /// The first bytes.
        begins: String,
    },
    /// The content is something else that is known: what it is, and what makes images of it.
    #[error("{}: this is {}, not an image; {}", .0.display(), .1, .2)]
    Foreign(PathBuf, &'static str, String),
    /// A video whose frames cannot be read: what it is, why, and what makes images of it.
    #[error("{}: this is {}, not an image, and no frame of it can be read: {}; {}", .0.display(), .1, .2, .3)]
    Film(PathBuf, &'static str, String, String),
    /// The file, of this format, ends before the image does: what is missing.
    #[error("{}: the {} file is cut off: {}; copy it again from where it was recorded", .0.display(), .1, .2)]
    Truncated(PathBuf, &'static str, String),
    /// The content of the file, of this format, contradicts itself.
    #[error("{}: the {} file is damaged: {}; copy it again or save it anew", .0.display(), .1, .2)]
    Corrupt(PathBuf, &'static str, String),
    /// A kind of image that is not read.
    #[error("{}: {what} cannot be read in a {format} file; save it as grey 8 or 16 bit TIFF or PNG", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: &'static str,
        /// The kind.
        what: String,
    },
    /// More pixels than an image may have.
    #[error(
        "{}: {width} x {height} px in the header of the {format} file, more than {max_mpx} million; {}, or copy the file \
         again if it has another size",
        path.display(), larger(*max_mpx)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: &'static str,
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// The most pixels, in millions.
        max_mpx: u32,
    },
    /// An image of another size than the reference.
    #[error("{}: the image is {width} x {height} px, the reference {} x {} px", path.display(), wanted[0], wanted[1])]
    OtherSize {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// Columns and rows of the reference.
        wanted: [usize; 2],
    },
    /// The image does not fit in the memory that this process may have.
    #[error(
        "{}: {width} x {height} px need {:.1} GB of memory, more than this process can have; crop or bin the image, or copy \
         the file again if it has another size",
        path.display(), *bytes as f64 / 1e9
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// Bytes of the unpacked image.
        bytes: u128,
    },
    /// The file has fewer pages.
    #[error("{}: there is no page {page}: the file holds {pages} (the first is page 0)", path.display())]
    NoSuchPage {
        /// The file.
        path: PathBuf,
        /// The page asked for.
        page: usize,
        /// Pages in the file.
        pages: usize,
    },
    /// Grey levels that cannot be used, such as NaN.
    #[error("{}: {reason}", path.display())]
    GreyLevels {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        reason: ImageError,
    },
}

impl ReadError {
    /// That the file `path` is something else that is known; `None` of what may be an image.
    pub fn of_foreign(path: &Path) -> Option<Self> {
        Foreign::at(path).map(|foreign| Self::Foreign(path.to_owned(), foreign.what, foreign.remedy(path)))
    }
}

/// What helps an image of more than `max_mpx` million pixels.
fn larger(max_mpx: u32) -> String {
    if max_mpx < Accepted::MOST_MPX {
        format!("allow it with --max-image-mpx (up to {})", Accepted::MOST_MPX)
    } else {
        "crop or bin the image".into()
    }
}

/// Reads the image file `path`, of a TIFF file the page `page` (0 is the first).
///
/// The content decides the format, not the name: TIFF, PNG, BMP, JPEG, PGM/PPM. Grey levels keep their depth; colours
/// become luminance (Rec. 709) as 32-bit floats in the scale of the file, unless all channels are equal; alpha is
/// ignored. Palettes are applied, and so is the orientation in EXIF data or a TIFF page: coordinates are those of the
/// picture as viewers show it.
///
/// # Errors
/// See [`ReadError`]: each names the file, what is wrong and what to do.
pub fn read_image(path: &Path, page: usize) -> Result<Loaded, ReadError> {
    read_accepted(path, page, Accepted::default())
}

/// As [`read_image`], with a limit of one's own: nothing larger, or of another size, is unpacked.
///
/// # Errors
/// As [`read_image`].
pub fn read_accepted(path: &Path, page: usize, accepted: Accepted) -> Result<Loaded, ReadError> {
    PagedFile::open(path)?.read_one(page, accepted)
}

/// Above so many bytes a TIFF file of several pages is not read as a whole.
const LARGE: u64 = 64 << 20;

/// An image file, from which pages are decoded one by one without opening it again.
#[derive(Debug)]
pub struct PagedFile {
    path: PathBuf,
    content: Content,
    format: Format,
    /// Once found.
    pages: Option<Arc<tiff_pages::PageList>>,
    /// Once computed.
    sha256: Option<String>,
}

#[derive(Debug)]
enum Content {
    Whole(Vec<u8>),
    /// A TIFF file of which a page at a time is read.
    Large(LargeFile),
    Film(Film),
}

impl PagedFile {
    /// Opens the file `path`; a large stack or a video is not read as a whole. Nothing is decoded yet.
    ///
    /// # Errors
    /// A file that cannot be read, is empty, or holds no image of a known format.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let fault = |reason| unreadable(path, reason);
        check_regular(path).map_err(fault)?;
        let file = LargeFile::open(path).map_err(fault)?;
        let head = file.piece(0, file.len().min(16)).unwrap_or_default().into_owned();
        if tiff_pages::is_tiff(&head) && file.len() as u64 > LARGE {
            let mut large = Self::with(path.to_owned(), Content::Large(file), Format::Tiff);
            large.images()?;
            if large.pages.as_ref().is_some_and(|pages| pages.len() > 1) {
                return Ok(large);
            }
        } else if let Some(foreign) = Foreign::of(path, &head).filter(|foreign| foreign.is_film()) {
            let film =
                Film::open(path, file, foreign).map_err(|problem| named(problem, path, Format::Film.name(), 0))?;
            return Ok(Self::with(path.to_owned(), Content::Film(film), Format::Film));
        }
        Self::of(path.to_owned(), read_regular(path).map_err(fault)?)
    }

    fn with(path: PathBuf, content: Content, format: Format) -> Self {
        Self { path, content, format, pages: None, sha256: None }
    }

    /// The same with the content of the file at hand; `path` stands in messages.
    ///
    /// # Errors
    /// No bytes, or none of a known format.
    pub fn of(path: PathBuf, bytes: Vec<u8>) -> Result<Self, ReadError> {
        if bytes.is_empty() {
            return Err(ReadError::Empty(path));
        }
        if let Some(film) = Film::of(&path, &bytes) {
            let film = film.map_err(|problem| named(problem, &path, Format::Film.name(), 0))?;
            return Ok(Self::with(path, Content::Film(film), Format::Film));
        }
        let format = Format::of(&bytes, &path)?;
        Ok(Self::with(path, Content::Whole(bytes), format))
    }

    /// The pages that are images of their own (no thumbnails), or the frames of a video, from 0. Other files have one.
    ///
    /// # Errors
    /// A TIFF file whose list of pages is damaged, or cannot be read to its end.
    pub fn images(&mut self) -> Result<Vec<usize>, ReadError> {
        let images = self.page_list().map(|list| match (list, &self.content) {
            (Some(list), Content::Whole(bytes)) => list.images(bytes.as_slice()),
            (Some(list), Content::Large(file)) => list.images(file),
            (_, Content::Film(film)) => (0..film.len()).collect(),
            (None, _) => vec![0],
        });
        self.checked(images, 0)
    }

    /// What was read, unless the disk has refused a part of it.
    fn checked<T>(&mut self, read: Result<T, ImageFault>, page: usize) -> Result<T, ReadError> {
        let refused = match &mut self.content {
            Content::Large(file) => file.take_error(),
            Content::Film(film) => film.take_error(),
            Content::Whole(_) => None,
        };
        match refused {
            Some(reason) => Err(ReadError::Io(self.path.clone(), reason)),
            None => read.map_err(|problem| named(problem, &self.path, self.format.name(), page)),
        }
    }

    /// Decodes the page `page` (0 is the first) where it is `accepted`.
    ///
    /// # Errors
    /// As [`read_image`].
    pub fn read(&mut self, page: usize, accepted: Accepted) -> Result<Loaded, ReadError> {
        let decoded = self.decode(page, accepted);
        let (mut raw, pages) = self.checked(decoded, page)?;
        let pixels = raw.channels.grey(raw.pixels, &mut raw.notes);
        let ([width, height], pixels) = raw.orientation.upright([raw.width, raw.height], pixels);
        raw.notes.extend(raw.orientation.note());
        let image = Image::new(width, height, pixels)
            .map_err(|reason| ReadError::GreyLevels { path: self.path.clone(), reason })?;
        let sha256 = self.sha256.clone().unwrap_or_else(|| sha256_of(&image));
        let time_s = if let Content::Film(film) = &self.content { film.time_s(page) } else { None };
        Ok(Loaded { image, notes: raw.notes, sha256, pages, white: raw.white, taken: raw.taken, time_s })
    }

    /// [`Loaded::sha256`] of the page `page`, which is not decoded where the file is hashed as a whole.
    ///
    /// # Errors
    /// As [`PagedFile::read`].
    pub fn sha256(&mut self, page: usize) -> Result<String, ReadError> {
        match &self.content {
            Content::Whole(bytes) => Ok(self.sha256.get_or_insert_with(|| sha256(bytes)).clone()),
            _ => self.read(page, Accepted::ANY).map(|loaded| loaded.sha256),
        }
    }

    /// As [`PagedFile::read`], where no other page is wanted: the notes say how many there are.
    pub(super) fn read_one(&mut self, page: usize, accepted: Accepted) -> Result<Loaded, ReadError> {
        let mut loaded = self.read(page, accepted)?;
        if loaded.pages > 1 {
            let (pages, all) = (loaded.pages, "--pages all takes each as a frame");
            loaded.notes.push(format!("{pages} pages: page {page} is read; --page chooses another, {all}"));
        }
        Ok(loaded)
    }

    fn page_list(&mut self) -> Result<Option<Arc<tiff_pages::PageList>>, ImageFault> {
        if self.pages.is_none() && matches!(self.format, Format::Tiff) {
            self.pages = match &self.content {
                Content::Whole(bytes) => Some(Arc::new(tiff_pages::PageList::of(bytes.as_slice())?)),
                Content::Large(file) => Some(Arc::new(tiff_pages::PageList::of(file)?)),
                Content::Film(_) => None,
            };
        }
        Ok(self.pages.clone())
    }

    fn decode(&mut self, page: usize, accepted: Accepted) -> Result<(Raw, usize), ImageFault> {
        let list = self.page_list()?;
        if let Content::Whole(bytes) = &self.content {
            // Decoding a TIFF page edits the bytes for a while: their hash is that of the file.
            self.sha256.get_or_insert_with(|| sha256(bytes));
        }
        match (&mut self.content, list, self.format) {
            (Content::Film(film), ..) => Ok((film.decode(page, accepted)?, film.len())),
            (Content::Whole(bytes), Some(list), _) => {
                Ok((list.decode(bytes.as_mut_slice(), page, accepted)?, list.len()))
            }
            (Content::Large(file), Some(list), _) => Ok((list.decode(file, page, accepted)?, list.len())),
            (Content::Whole(bytes), None, Format::Pfm) if page == 0 => Ok((pfm::decode(bytes, accepted)?, 1)),
            (Content::Whole(bytes), None, Format::Other(format)) if page == 0 => {
                Ok((decode(bytes, format, accepted)?, 1))
            }
            _ => Err(ImageFault::NoSuchPage { pages: 1 }),
        }
    }
}

/// SHA-256 of the grey levels of an image, rows from the top, little endian.
fn sha256_of(image: &Image) -> String {
    match image.pixels() {
        Levels::U8(levels) => sha256(levels),
        Levels::U16(levels) => sha256(&levels.iter().flat_map(|level| level.to_le_bytes()).collect::<Vec<_>>()),
        Levels::F32(levels) => sha256(&levels.iter().flat_map(|level| level.to_le_bytes()).collect::<Vec<_>>()),
    }
}

/// Pages of `path` that are images of their own, or frames of a video; the first of what has no pages or cannot be
/// opened.
///
/// # Errors
/// A stack or video that cannot be read, or whose list of pages is damaged: how many frames it is nobody knows.
pub fn pages_of(path: &Path) -> Result<Vec<usize>, ReadError> {
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(16).read_to_end(&mut head));
    let is_stack = path.is_file()
        && read.is_ok()
        && (tiff_pages::is_tiff(&head) || Foreign::of(path, &head).is_some_and(Foreign::is_film));
    if is_stack { PagedFile::open(path)?.images() } else { Ok(vec![0]) }
}

fn unreadable(path: &Path, reason: io::Error) -> ReadError {
    let path = path.to_owned();
    match reason.kind() {
        ErrorKind::NotFound => ReadError::NotFound(path),
        _ if path.is_dir() => ReadError::Directory(path),
        _ => ReadError::Io(path, reason),
    }
}

fn named(problem: ImageFault, path: &Path, format: &'static str, page: usize) -> ReadError {
    let mut path = path.to_owned();
    if page > 0 && matches!(problem, ImageFault::OtherSize { .. }) {
        // The other pages may be of the right size.
        path.as_mut_os_string().push(format!("[{page}]"));
    }
    match problem {
        ImageFault::Truncated(what) => ReadError::Truncated(path, format, what),
        ImageFault::Corrupt(what) => ReadError::Corrupt(path, format, what),
        ImageFault::Unsupported(what) => ReadError::Unsupported { path, format, what },
        ImageFault::TooLarge { width, height, max_mpx } => ReadError::TooLarge { path, format, width, height, max_mpx },
        ImageFault::OtherSize { width, height, wanted } => ReadError::OtherSize { path, width, height, wanted },
        ImageFault::Memory { width, height, bytes } => ReadError::Memory { path, width, height, bytes },
        ImageFault::Film(what, why, todo) => ReadError::Film(path, what, why, todo),
        ImageFault::NoSuchPage { pages } => ReadError::NoSuchPage { path, page, pages },
    }
}

#[derive(Debug, Clone, Copy)]
enum Format {
    Tiff,
    Film,
    Pfm,
    Other(ImageFormat),
}

impl Format {
    fn of(bytes: &[u8], path: &Path) -> Result<Self, ReadError> {
        if tiff_pages::is_tiff(bytes) {
            return Ok(Format::Tiff);
        }
        if pfm::is_pfm(bytes) {
            return Ok(Format::Pfm);
        }
        if let Some(foreign) = Foreign::of(path, bytes) {
            return Err(ReadError::Foreign(path.to_owned(), foreign.what, foreign.remedy(path)));
        }
        match image::guess_format(bytes) {
            Ok(format) if Format::Other(format).is_read() => Ok(Format::Other(format)),
            Ok(other) => Err(ReadError::Unsupported {
                path: path.to_owned(),
                format: Format::Other(other).name(),
                what: "the image".into(),
            }),
            Err(_) => Err(ReadError::NotAnImage { path: path.to_owned(), begins: beginning(bytes) }),
        }
    }

    fn is_read(self) -> bool {
        use ImageFormat::{Bmp, Jpeg, Png, Pnm};
        matches!(self, Format::Tiff | Format::Pfm | Format::Other(Png | Bmp | Jpeg | Pnm))
    }

    fn name(self) -> &'static str {
        match self {
            Format::Tiff => "TIFF",
            Format::Film => "video",
            Format::Pfm => "PFM",
            Format::Other(ImageFormat::Png) => "PNG",
            Format::Other(ImageFormat::Bmp) => "BMP",
            Format::Other(ImageFormat::Jpeg) => "JPEG",
            Format::Other(ImageFormat::Pnm) => "PGM/PPM",
            Format::Other(ImageFormat::Gif) => "GIF",
            Format::Other(ImageFormat::WebP) => "WebP",
            Format::Other(ImageFormat::Hdr) => "Radiance HDR",
            Format::Other(ImageFormat::OpenExr) => "OpenEXR",
            Format::Other(ImageFormat::Avif) => "AVIF",
            Format::Other(_) => "foreign",
        }
    }
}

/// The first bytes as text, or as numbers when they are no text.
pub(super) fn beginning(bytes: &[u8]) -> String {
    let head = bytes.get(..16).unwrap_or(bytes);
    if head.iter().all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) {
        return format!("the text \"{}\"", head.escape_ascii());
    }
    let numbers: Vec<_> = head.iter().take(8).map(|b| format!("{b:02x}")).collect();
    format!("the bytes {}", numbers.join(" "))
}
