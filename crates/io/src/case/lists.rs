//! Lists as a user writes them, and what is said when they are none.

use schemars::JsonSchema;
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// The entries of a list.
pub(super) fn all<'de, T: Deserialize<'de>, A: SeqAccess<'de>>(mut list: A) -> Result<Vec<T>, A::Error> {
    std::iter::from_fn(|| list.next_element().transpose()).collect()
}

/// A list of exactly `N`; what it holds, in the words of a user.
struct Exactly<T, const N: usize> {
    /// Whose entries are counted, with a blank behind, where the key holds several lists; else nothing.
    whose: &'static str,
    expected: &'static str,
    entry: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>, const N: usize> Exactly<T, N> {
    fn read<D: Deserializer<'de>>(
        deserializer: D,
        whose: &'static str,
        expected: &'static str,
    ) -> Result<[T; N], D::Error> {
        deserializer.deserialize_any(Self { whose, expected, entry: PhantomData })
    }
}

impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Exactly<T, N> {
    type Value = [T; N];

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.expected)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<[T; N], A::Error> {
        let entries = all(list)?;
        let (n, Self { whose, expected, .. }) = (entries.len(), self);
        let entries_there = if n == 1 { "entry" } else { "entries" };
        entries
            .try_into()
            .map_err(|_| de::Error::custom(format!("{whose}has {n} {entries_there}, expected {expected}")))
    }
}

/// Two numbers.
pub(super) fn point<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 2], D::Error> {
    Exactly::read(deserializer, "", "two numbers [x, y]")
}

/// A range.
pub(super) fn two_numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 2]>, D::Error> {
    Exactly::read(deserializer, "", "two numbers [from, to]").map(Some)
}

/// Two names.
pub(super) fn two_names<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[String; 2], D::Error> {
    Exactly::read(deserializer, "", "two names [\"upper\", \"lower\"], those of two [[zone]]")
}

/// Two names, as [interface] has them.
pub(super) fn lower_upper<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[String; 2], D::Error> {
    Exactly::read(deserializer, "", "two names [\"lower\", \"upper\"], those of the two [[zone]] beside the adhesive")
}

/// A name that stands in tables, file names and messages: a line break in it would break all three.
pub(super) fn name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    let name = String::deserialize(deserializer)?;
    match name.chars().find(|c| c.is_control()) {
        None => Ok(Some(name)),
        Some(c) => {
            let what = format!("the name {name:?} holds a control character ({c:?}); use letters and digits");
            Err(de::Error::custom(what))
        }
    }
}

/// Four numbers.
pub(super) fn four_numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[f64; 4]>, D::Error> {
    Exactly::read(deserializer, "", "four numbers [x0, y0, x1, y1]").map(Some)
}

/// A corner of a polygon.
#[derive(Deserialize)]
pub(super) struct Corner(#[serde(deserialize_with = "corner")] [f64; 2]);

fn corner<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 2], D::Error> {
    Exactly::read(deserializer, "a point ", "a point [x, y]")
}

/// Corners of polygons as plain pairs.
pub(super) fn pairs(corners: Vec<Corner>) -> Vec<[f64; 2]> {
    corners.into_iter().map(|Corner(at)| at).collect()
}

/// A list of points.
pub(super) fn polygon<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<[f64; 2]>>, D::Error> {
    Vec::deserialize(deserializer).map(|corners| Some(pairs(corners)))
}

/// Polygons, each as its corners.
type Polygons = Vec<Vec<[f64; 2]>>;

/// A list of lists of points.
pub(super) fn polygons<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Polygons>, D::Error> {
    let polygons: Vec<Vec<Corner>> = Vec::deserialize(deserializer)?;
    Ok(Some(polygons.into_iter().map(pairs).collect()))
}

/// What a file holds for a list of names.
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "it is there for its schema")]
pub(super) enum OneOrMore {
    One(String),
    More(Vec<String>),
}

/// Accepts one string for a list of one.
pub(super) fn one_or_more<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<String>>, D::Error> {
    struct Names;
    impl<'de> Visitor<'de> for Names {
        type Value = Vec<String>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a file name or glob in quotes, or a list of them")
        }

        fn visit_str<E: de::Error>(self, name: &str) -> Result<Vec<String>, E> {
            Ok(vec![name.to_owned()])
        }

        fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Vec<String>, A::Error> {
            all(list)
        }
    }
    deserializer.deserialize_any(Names).map(Some)
}

/// Writes a list of one as one string.
pub(super) fn one_or_list<S: Serializer>(names: &Option<Vec<String>>, serializer: S) -> Result<S::Ok, S::Error> {
    match names.as_deref() {
        Some([name]) => name.serialize(serializer),
        names => names.serialize(serializer),
    }
}
