//! Images for tests of pictures, which look at colours and not at grey levels.

use quadrille::imaging::{Image, Pixels};

/// Smooth blobs of about 5 px, 8 bit.
pub fn speckle(width: usize, height: usize) -> Image {
    let grey = |x: f64, y: f64| {
        let waves = [(1.1, 0.4, 0.3), (-0.5, 1.2, 1.9), (0.9, -0.8, 4.1), (0.2, 0.9, 2.2), (-1.0, -0.3, 5.3)];
        let sum: f64 = waves.iter().map(|(a, b, c)| (a * x + b * y + c + (0.05 * (a * y - b * x)).sin()).sin()).sum();
        (127.5 + 60.0 * sum).clamp(0.0, 255.0) as u8
    };
    let pixels = (0..width * height).map(|k| grey((k % width) as f64, (k / width) as f64)).collect();
    Image::new(width, height, Pixels::U8(pixels)).unwrap()
}

/// One grey level everywhere, 8 bit.
pub fn uniform(width: usize, height: usize, grey: u8) -> Image {
    Image::new(width, height, Pixels::U8(vec![grey; width * height])).unwrap()
}
