//! PFM: floats of 32 bits, grey (`Pf`) or colours (`PF`), rows from the bottom (Netpbm, "PFM Format").

use super::raw::{Accepted, Channels, ImageFault, Raw, check_size};
use super::upright::Orientation;
use crate::imaging::Pixels;

/// The header is short.
const LONGEST_HEADER: usize = 100;

/// Whether a file begins as one.
pub(super) fn is_pfm(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'f' | b'F', sign, ..] if sign.is_ascii_whitespace())
}

/// The image of a file.
pub(super) fn decode(bytes: &[u8], accepted: Accepted) -> Result<Raw, ImageFault> {
    let mut at = 0;
    let mut word = || {
        let is_space = |&at: &usize| bytes.get(at).is_some_and(u8::is_ascii_whitespace);
        let start = (at..LONGEST_HEADER).find(|at| !is_space(at))?;
        let end = (start..LONGEST_HEADER).find(is_space)?;
        at = end;
        std::str::from_utf8(bytes.get(start..end)?).ok()
    };
    let header = (word(), word().and_then(|w| w.parse().ok()), word().and_then(|w| w.parse().ok()), word());
    let (Some(kind), Some(width), Some(height), Some(scale)) = header else {
        return Err(ImageFault::Corrupt("its header has no width, height and scale".into()));
    };
    let scale = scale.parse::<f32>().ok().filter(|scale| scale.is_finite() && *scale != 0.0);
    let scale = scale.ok_or_else(|| ImageFault::Corrupt("the scale in its header is not a number".into()))?;
    let n = if kind == "PF" { 3 } else { 1 };
    // One sign stands between header and numbers.
    let numbers = bytes.get(at + 1..).unwrap_or_default();
    check_size(accepted, width, height, u128::from(width) * u128::from(height) * 4 * n as u128, 1, numbers.len())?;
    let (width, height) = (width as usize, height as usize);
    let of_bytes = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let row = |row: &[u8]| row.chunks_exact(4).map(|four| of_bytes(four.try_into().unwrap_or_default())).collect();
    let rows: Vec<Vec<f32>> = numbers.chunks_exact(4 * n * width).take(height).map(row).collect();
    let pixels = Pixels::F32(rows.into_iter().rev().flatten().collect());
    let mut notes = Vec::new();
    if scale.abs() != 1.0 {
        notes.push(format!("the scale {} of its header is not applied", scale.abs()));
    }
    let channels = Channels { n, colour: n == 3, planar: false };
    let orientation = Orientation::of(1);
    Ok(Raw { width, height, channels, pixels, white: 1.0, notes, taken: None, orientation })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_from_the_bottom_in_the_byte_order_that_the_sign_of_the_scale_says() {
        let floats = [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0];
        let little = [b"Pf\n3 2\n-1.0\n".to_vec(), floats.iter().flat_map(|v| v.to_le_bytes()).collect()].concat();
        let big = [b"Pf 3 2 1 ".to_vec(), floats.iter().flat_map(|v| v.to_be_bytes()).collect()].concat();
        for file in [&little, &big] {
            assert!(is_pfm(file));
            let raw = decode(file, Accepted::ANY).ok().unwrap();
            assert_eq!((raw.width, raw.height), (3, 2));
            assert!(matches!(raw.pixels, Pixels::F32(found) if found == [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]));
        }
        let fault = |file: &[u8]| format!("{:?}", decode(file, Accepted::ANY).err());
        assert!(fault(&little[..little.len() - 1]).contains("Truncated"));
        assert!(fault(b"Pf\n3 2\n0\n").contains("scale"));
        assert!(fault(b"Pf\n3\n").contains("header"));
        assert!(fault(b"Pf\n0 2\n-1\n").contains("0 x 2"));
        assert!(fault(b"Pf\n99999999999 99999999999\n-1\n").contains("TooLarge"));
    }
}
