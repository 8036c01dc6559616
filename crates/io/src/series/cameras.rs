//! Two cameras whose images lie in one folder.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// Words that tell two views apart, and numbers behind one of [`CAMERAS`].
const VIEWS: [[&str; 2]; 3] = [["l", "r"], ["left", "right"], ["links", "rechts"]];
const COUNTS: [[&str; 2]; 3] = [["0", "1"], ["1", "2"], ["a", "b"]];
const CAMERAS: [&str; 5] = ["cam", "camera", "kamera", "sensor", "view"];
/// Of numbers alone so many instants are needed: two may be anything.
const INSTANTS: usize = 3;

/// Images of two cameras in one series, as their names say it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TwoCameras {
    /// What stands for each in the names, such as `cam0` and `cam1`.
    pub names: [String; 2],
    /// A pattern for the images of each.
    pub patterns: [String; 2],
    /// Whether the names can mean nothing else. Of numbers alone, `_0` and `_1`, each load may have two images.
    pub certain: bool,
}

/// The two cameras whose images `files` are, where every instant has one of both.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::series::two_cameras;
/// let files = ["a_0_L.tif", "a_0_R.tif", "a_1_L.tif", "a_1_R.tif"].map(std::path::PathBuf::from);
/// let found = two_cameras(&files).unwrap();
/// assert_eq!((found.patterns, found.certain), (["a_*_L.tif".to_owned(), "a_*_R.tif".to_owned()], true));
/// ```
pub fn two_cameras(files: &[PathBuf]) -> Option<TwoCameras> {
    let names: Vec<Vec<&str>> = files.iter().map(|file| file.to_str().map(words)).collect::<Option<_>>()?;
    let least = names.iter().map(Vec::len).min()?;
    // From the end on, where the names are alike also if they begin with texts of other length.
    (1..=least).find_map(|at| at_place(&names, at))
}

/// A name as its words: letters, digits, and each other sign.
fn words(name: &str) -> Vec<&str> {
    let kind = |c: char| match c {
        c if c.is_ascii_digit() => 0,
        c if c.is_alphabetic() => 1,
        _ => 2,
    };
    let mut words = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let others = rest.char_indices().skip(1).find(|&(_, c)| kind(first) == 2 || kind(c) != kind(first));
        let (word, behind) = rest.split_at(others.map_or(rest.len(), |(at, _)| at));
        words.push(word);
        rest = behind;
    }
    words
}

/// Two cameras told apart by the word that is `at` from the end.
fn at_place(names: &[Vec<&str>], at: usize) -> Option<TwoCameras> {
    let word =
        |name: &[&str], at: usize| name.len().checked_sub(at).and_then(|k| name.get(k)).map(|word| word.to_lowercase());
    let first = word(names.first()?, at)?;
    let second = names.iter().filter_map(|name| word(name, at)).find(|word| *word != first)?;
    let (name, pair) = (names.first()?, [first.as_str(), second.as_str()]);
    let is_pair = |known: &[&str; 2]| *known == pair || *known == [pair[1], pair[0]];
    let before = word(name, at + 1).unwrap_or_default();
    let with_word = CAMERAS.map(|camera| COUNTS.map(|count| count.map(|count| format!("{camera}{count}"))));
    let is_camera = COUNTS.iter().any(is_pair) && CAMERAS.contains(&before.as_str())
        || with_word.iter().flatten().any(|known| is_pair(&[&known[0], &known[1]]));
    let certain = VIEWS.iter().any(is_pair) || is_camera;
    let counted = COUNTS.iter().take(2).any(is_pair) && ["_", "-"].contains(&before.as_str());
    if !certain && !counted {
        return None;
    }
    // Every instant has both, and nothing else is there.
    let mut instants: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    let mut series: [Vec<&Vec<&str>>; 2] = [Vec::new(), Vec::new()];
    for name in names {
        let which = pair.iter().position(|own| word(name, at).as_deref() == Some(own))?;
        let others = name.iter().enumerate().filter(|(k, _)| k + at != name.len()).map(|(_, word)| *word);
        *instants.entry(others.collect::<Vec<_>>().join("\0")).or_default().get_mut(which)? += 1;
        series.get_mut(which)?.push(name);
    }
    let least = if certain { 2 } else { INSTANTS };
    if instants.len() < least || instants.values().any(|both| *both != [1, 1]) {
        return None;
    }
    let mut series = series.map(|series| (pattern_of(&series), named(&series, at, is_camera)));
    series.sort();
    let [(first, own), (second, other)] = series;
    Some(TwoCameras { names: [own, other], patterns: [first, second], certain })
}

/// What tells the images of a series: the word, with the one before it where that belongs to it.
fn named(series: &[&Vec<&str>], at: usize, is_camera: bool) -> String {
    let Some(name) = series.first() else { return String::new() };
    let from = |at: usize| name.len().checked_sub(at).and_then(|k| name.get(k)).copied().unwrap_or_default();
    let word = from(at);
    let with_before = is_camera && word.len() == 1 || !is_camera && word.bytes().all(|c| c.is_ascii_digit());
    if with_before { format!("{}{word}", from(at + 1)) } else { word.to_owned() }
}

/// The pattern of these names: what all have in common, counted from their ends.
fn pattern_of(series: &[&Vec<&str>]) -> String {
    let least = series.iter().map(|name| name.len()).min().unwrap_or(0);
    let same_length = series.iter().all(|name| name.len() == least);
    let from_end =
        |name: &[&str], at: usize| name.len().checked_sub(at).and_then(|k| name.get(k)).map(|word| (*word).to_owned());
    let mut parts: Vec<String> = if same_length { Vec::new() } else { vec!["*".to_owned()] };
    for at in (1..=least).rev() {
        let word = series.first().and_then(|name| from_end(name, at)).unwrap_or_default();
        let is_common = series.iter().all(|name| from_end(name, at).as_deref() == Some(&word));
        match is_common {
            true => parts.push(glob::Pattern::escape(&word)),
            false if parts.last().is_none_or(|last| last != "*") => parts.push("*".to_owned()),
            false => {}
        }
    }
    parts.concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(names: &[&str]) -> Option<([String; 2], bool)> {
        let files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
        two_cameras(&files).map(|found| (found.patterns, found.certain))
    }

    #[test]
    fn names_of_two_cameras_give_two_patterns() {
        let both = |a: &str, b: &str, certain: bool| Some(([a.to_owned(), b.to_owned()], certain));
        let stereo = [
            "img_0000_0.png",
            "img_0000_1.png",
            "img_0001_0.png",
            "img_0001_1.png",
            "img_0012_0.png",
            "img_0012_1.png",
        ];
        assert_eq!(found(&stereo), both("img_*_0.png", "img_*_1.png", false));
        assert_eq!(
            found(&["cam0_1.tif", "cam0_2.tif", "cam1_1.tif", "cam1_2.tif"]),
            both("cam0_*.tif", "cam1_*.tif", true)
        );
        assert_eq!(
            found(&["s/left/1.tif", "s/left/10.tif", "s/right/1.tif", "s/right/10.tif"]),
            both("s/left/*.tif", "s/right/*.tif", true)
        );
        assert_eq!(
            found(&["t_camA_1.tif", "t_camB_1.tif", "t_camA_2.tif", "t_camB_2.tif"]),
            both("t_camA_*.tif", "t_camB_*.tif", true)
        );
    }

    #[test]
    fn a_name_that_is_counted_in_two_ways_is_not_taken_for_two_cameras() {
        for names in [
            &["img_0.tif", "img_1.tif"][..],
            &["img_0.tif", "img_1.tif", "img_2.tif"],
            &["a_0.tif", "a_1.tif", "b_0.tif", "b_1.tif"], // two instants of numbers alone
            &["img_1_0.tif", "img_1_1.tif", "img_2_0.tif", "img_2_1.tif", "img_3_0.tif"], // one is missing
            &["load1_L.tif", "load2_L.tif"],
            &["ref_l.tif", "a_l.tif", "a_r.tif"],
            &["img_1_0.tif", "img_1_1.tif", "img_1_2.tif", "img_2_0.tif"],
        ] {
            assert_eq!(found(names), None, "{names:?}");
        }
    }
}
