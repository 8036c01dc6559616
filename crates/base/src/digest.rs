//! SHA-256 of bytes: what names a file's content in records, and a script that a page allows. By `ring`, whose code for
//! processors without instructions for it takes half the time of others: every image of a series is hashed, which was
//! half of what such a host did beside a graphics card (ARCHITECTURE.md, "Tried, and left").

use ring::digest::{SHA256, digest};
use std::fmt::Write as _;

/// SHA-256 of `bytes`.
pub fn sha256(bytes: &[u8]) -> [u8; 32] {
    let mut sum = [0; 32];
    sum.copy_from_slice(digest(&SHA256, bytes).as_ref());
    sum
}

/// The same in hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    sha256(bytes).iter().fold(String::new(), |mut text, byte| {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}
