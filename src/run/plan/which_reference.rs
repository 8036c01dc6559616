//! Which file of a series is the reference, when nobody says: what the names of the files have to say about it.

use crate::io::images::Foreign;
use crate::io::series::{NameOrder, two_cameras};
use crate::remark::Remark;
use crate::run::words::{Result, RunError, remarks};
use std::path::{Path, PathBuf};

/// Words in a name that say it shows the specimen before the test.
const SAYS_REFERENCE: &str = "ref reference refimage refimg refframe referenz unloaded undeformed unstrained unstressed \
     undamaged initial zero static baseline unbelastet unverformt nullbild";
/// Endings of files that lie beside images and are none.
const NO_IMAGE: &[&str] = &[
    "txt", "csv", "tsv", "dat", "md", "rst", "log", "json", "toml", "yaml", "yml", "xml", "ini", "cfg", "html", "htm",
    "pdf", "doc", "docx", "xls", "xlsx", "ods", "odt", "rtf", "tex", "db", "py", "m", "mat", "npy", "npz", "ipynb",
    "sh", "bat", "zip", "gz", "tar", "7z", "rar", "sha256", "md5", "avi", "mp4", "mov", "m4v", "mkv", "webm", "wmv",
    "mpg", "mpeg", "cine", "mraw", "cih", "cihx", "h5", "hdf5",
];

/// Takes the files out that are no images by their ending and by how they begin, as long as images are left; gives
/// them. A video stays beside one image, which is its reference.
pub(crate) fn without_texts(files: &mut Vec<PathBuf>) -> Vec<PathBuf> {
    let is_text = |path: &Path| {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        ending.is_some_and(|ending| NO_IMAGE.contains(&ending.as_str())) && path.is_file() && !begins_as_image(path)
    };
    let mut texts: Vec<PathBuf> = files.iter().filter(|path| is_text(path)).cloned().collect();
    if texts.len() + 1 == files.len() && texts.iter().filter(|path| Foreign::is_film_at(path)).count() == 1 {
        texts.retain(|path| !Foreign::is_film_at(path));
    }
    if texts.len() == files.len() {
        return Vec::new();
    }
    files.retain(|path| !texts.contains(path));
    texts
}

fn begins_as_image(path: &Path) -> bool {
    use std::io::Read;
    let mut head = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(16).read_to_end(&mut head));
    let starts = |magic: &[u8]| head.starts_with(magic);
    let tiff = [b"II*\0", b"II+\0", b"MM\0*", b"MM\0+"].iter().any(|magic| starts(*magic));
    let bitmap = starts(b"BM") && head.get(6..10) == Some(&[0; 4]);
    let pnm = starts(b"P") && matches!(head.get(1..3), Some([b'1'..=b'7', space]) if space.is_ascii_whitespace());
    read.is_ok() && (tiff || bitmap || pnm || starts(b"\x89PNG") || starts(b"\xff\xd8\xff"))
}

/// What there is to say of the names of a series, of which some files were `left_out`, some for their `capitals`.
/// Errors: the images of two cameras.
pub(crate) fn about_names(files: &[PathBuf], left_out: &[PathBuf], capitals: &[PathBuf]) -> Result<Vec<Remark>> {
    let cameras = two_cameras(files);
    if let Some(cameras) = cameras.as_ref().filter(|cameras| cameras.certain) {
        return Err(RunError::TwoCameras(remarks::cameras_of(cameras)));
    }
    let (left_out, capitals) = (remarks::files_left_out(left_out), remarks::but_for_capitals(capitals));
    let said = [left_out, capitals, remarks::order_of_names(files)].into_iter().flatten();
    Ok(said.chain(cameras.as_ref().map(remarks::cameras_mixed)).collect())
}

/// Whether the names of the files contradict that the first of them is the reference.
/// Errors: [`RunError::WhichReference`] with the file that says so.
pub(crate) fn check(files: &[PathBuf]) -> Result<()> {
    let Some((first, others)) = files.split_first() else { return Ok(()) };
    let own = words(first, first);
    let says = |words: &[String]| words.iter().any(|word| SAYS_REFERENCE.split(' ').any(|says| says == word));
    if says(&own) {
        return Ok(()); // the first one says so itself
    }
    let by_word = others.iter().find(|file| says(&words(file, first)));
    let order = NameOrder::of(files);
    match by_word.or_else(|| others.iter().find(|file| order.is_zero_of(file, first))) {
        Some(named) => Err(RunError::WhichReference { first: first.clone(), named: named.clone() }),
        None => Ok(()),
    }
}

/// The words of a file's name, in small letters: of its folder too when that is another than the first file's.
fn words(file: &Path, first: &Path) -> Vec<String> {
    let mut names: Vec<String> = file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).into_iter().collect();
    if file.parent() != first.parent() {
        names.extend(file.parent().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned()));
    }
    let mut words = Vec::new();
    for name in &names {
        let mut word = String::new();
        let mut before = ' ';
        for letter in name.chars() {
            // A capital begins a word after a small letter, as in refImage.
            if !letter.is_alphabetic() || (letter.is_uppercase() && before.is_lowercase()) {
                words.push(std::mem::take(&mut word));
            }
            if letter.is_alphabetic() {
                word.extend(letter.to_lowercase());
            }
            before = letter;
        }
        words.push(word);
    }
    words.retain(|word| !word.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(files: &[&str]) -> Option<String> {
        let files: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
        match check(&files) {
            Err(RunError::WhichReference { named, .. }) => Some(named.display().to_string()),
            _ => None,
        }
    }

    #[test]
    fn names_that_contradict_the_order_are_told() {
        for (files, wanted) in [
            (&["def_1.png", "def_2.png", "ref.png"][..], "ref.png"),
            (&["loaded.tif", "unloaded.tif"], "unloaded.tif"),
            (&["a.tif", "b.tif", "RefImage.tif"], "RefImage.tif"),
            (&["load1.bmp", "load2.bmp", "undeformed_1.bmp"], "undeformed_1.bmp"),
            (&["s/001.tif", "s/Zero load.tif"], "s/Zero load.tif"),
            (&["def/a.tif", "ref/a.tif"], "ref/a.tif"),
            (&["rotation_170.tif", "rotation_000.tif"], "rotation_000.tif"),
            (&["img3.png", "img2.png", "img0.png"], "img0.png"),
            (&["F=0.25kN.png", "F=0.5kN.png", "F=0kN.png"], "F=0kN.png"),
            (&["Sample14 L1 Amp0.1b.tif", "Sample14 Reference.tif"], "Sample14 Reference.tif"),
        ] {
            assert_eq!(named(files).as_deref(), Some(wanted), "{files:?}");
        }
    }

    #[test]
    fn names_that_do_not_are_left_in_peace() {
        for files in [
            &["ref.png", "def_1.png"][..],
            &["img_0000.tif", "img_0030.tif"],
            &["ref_1.tif", "ref_2.tif"],
            &["static_001.tif", "static_002.tif"],
            &["a_refined.tif", "b_reflection.tif", "preferred.tif"],
            &["cam0_5.tif", "cam0_6.tif"],
            &["x_10.tif", "y_0.tif"],
            &["T-20C.tif", "T0C.tif", "T20C.tif"],
            &["unloaded.tif", "loaded.tif"],
            &["only.tif"],
            &["ä_1.tif", "ä_2.tif"],
            &[],
        ] {
            assert_eq!(named(files), None, "{files:?}");
        }
    }
}
