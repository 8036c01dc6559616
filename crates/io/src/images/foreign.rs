//! Files that a user may take for images, by how they begin: named as what they are, with what to do.

use std::path::Path;

/// What a file is that is no image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Foreign {
    /// Its kind: `a video (AVI)`.
    pub what: &'static str,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Video,
    Camera,
    Arrays,
    Picture,
    Other,
}

/// A stream without an index.
const MPEG: &str = "a video (MPEG)";

/// Beginnings of files: at which byte, with what, and what the file is.
const BEGINNINGS: [(usize, &[u8], &str, Kind); 21] = [
    (8, b"AVI ", "a video (AVI)", Kind::Video),
    (4, b"ftypheic", "a picture of a telephone (HEIC)", Kind::Picture),
    (4, b"ftypheix", "a picture of a telephone (HEIC)", Kind::Picture),
    (4, b"ftypmif1", "a picture of a telephone (HEIC)", Kind::Picture),
    (4, b"ftypavif", "an AVIF picture", Kind::Picture),
    (4, b"ftypcrx ", "a raw file of a Canon camera (CR3)", Kind::Picture),
    (4, b"ftyp", "a video (MP4 or MOV)", Kind::Video),
    (4, b"moov", "a video (MOV)", Kind::Video),
    (0, b"\x1a\x45\xdf\xa3", "a video (MKV or WebM)", Kind::Video),
    (0, b"\x30\x26\xb2\x75", "a video (WMV)", Kind::Video),
    (0, b"\0\0\x01\xba", MPEG, Kind::Video),
    (0, b"\0\0\x01\xb3", MPEG, Kind::Video),
    (0, b"CI\x2c\0", "a film of a high-speed camera (cine)", Kind::Camera),
    (0, b"\x93NUMPY", "an array of NumPy (npy)", Kind::Arrays),
    (0, b"MATLAB 5.0", "a file of MATLAB (mat)", Kind::Arrays),
    (0, b"MATLAB 7.3", "a file of MATLAB (mat)", Kind::Arrays),
    (0, b"\x89HDF", "an HDF5 file", Kind::Arrays),
    (0, b"PK\x03\x04", "an archive (zip, npz or a document)", Kind::Other),
    (0, b"\x1f\x8b", "a packed file (gz)", Kind::Other),
    (0, b"%PDF", "a PDF document", Kind::Other),
    (0, b"\xd0\xcf\x11\xe0", "a document of an office program", Kind::Other),
];

/// Endings of files that have no beginning of their own.
const ENDINGS: [(&str, &str); 3] = [
    ("mraw", "the raw film of a high-speed camera (mraw)"),
    ("cihx", "the description of a film of a high-speed camera (cihx)"),
    ("cih", "the description of a film of a high-speed camera (cih)"),
];

impl Foreign {
    /// What the file `path` is that begins with `head`; `None` where it is nothing known. 16 bytes are enough.
    ///
    /// ```
    /// # use quadrille_io as quadrille;
    /// use quadrille::io::images::Foreign;
    /// let found = Foreign::of("test.avi".as_ref(), b"RIFF\0\0\0\0AVI LIST").unwrap();
    /// assert_eq!(found.what, "a video (AVI)");
    /// ```
    pub fn of(path: &Path, head: &[u8]) -> Option<Self> {
        let begins = |at: usize, with: &[u8]| head.get(at..).is_some_and(|rest| rest.starts_with(with));
        let found = BEGINNINGS.iter().find(|(at, with, ..)| begins(*at, with));
        if let Some((.., what, kind)) = found {
            return Some(Self { what, kind: *kind });
        }
        let ending = path.extension()?.to_str()?.to_lowercase();
        let (_, what) = ENDINGS.iter().find(|(known, _)| *known == ending)?;
        Some(Self { what, kind: Kind::Camera })
    }

    /// The same of a file that is opened for it.
    pub fn at(path: &Path) -> Option<Self> {
        use std::io::Read;
        let mut head = Vec::new();
        if !path.is_file() {
            return None; // a pipe might never say anything
        }
        std::fs::File::open(path).and_then(|file| file.take(16).read_to_end(&mut head)).ok()?;
        Self::of(path, &head)
    }

    /// Whether the file `path` is a video or the film of a camera.
    pub fn is_film_at(path: &Path) -> bool {
        Self::at(path).is_some_and(Self::is_film)
    }

    /// Whether frames may be read from it.
    pub(crate) fn is_film(self) -> bool {
        matches!(self.kind, Kind::Video | Kind::Camera)
    }

    /// Whether a video says where its frames are.
    pub(super) fn has_index(self) -> bool {
        self.what != MPEG
    }

    /// What makes images of it.
    pub fn remedy(self, path: &Path) -> String {
        match self.kind {
            Kind::Video => format!(
                "install ffmpeg, or take it apart first, for example: ffmpeg -i {} -pix_fmt gray frame_%05d.png",
                crate::text::shell_word(&path.display().to_string())
            ),
            Kind::Camera => "save its frames as TIFF with the program of the camera".to_owned(),
            Kind::Picture => "develop or save it as TIFF or PNG".to_owned(),
            Kind::Arrays => "write each image of it as TIFF or PNG".to_owned(),
            Kind::Other => "name the image files alone".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_told_by_their_beginning_and_else_by_their_ending() {
        for (name, head, wanted) in [
            ("a.mp4", &b"\0\0\0\x20ftypisom"[..], Some("MP4")),
            ("a.heic", b"\0\0\0\x20ftypheic", Some("HEIC")),
            ("a.cr3", b"\0\0\0\x20ftypcrx ", Some("CR3")),
            ("a.tif", b"\x93NUMPY\x01\0", Some("npy")),
            ("a.mat", b"MATLAB 5.0 MAT-f", Some("mat")),
            ("a.MRAW", b"\0\x01\0\x02", Some("mraw")),
            ("a.tif", b"II*\0\x08\0\0\0", None),
            ("a.png", b"", None),
        ] {
            let found = Foreign::of(Path::new(name), head);
            assert_eq!(found.is_some(), wanted.is_some(), "{name}");
            assert!(found.is_none_or(|found| found.what.contains(wanted.unwrap_or_default())), "{name}: {found:?}");
            assert!(found.is_none_or(|found| !found.remedy(Path::new(name)).is_empty()));
        }
    }
}
