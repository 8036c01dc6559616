//! The mean of several images, and how far they have moved between them.

use super::{Image, Pixels};

/// A sum of images of one size.
#[derive(Debug, Clone)]
pub struct Mean {
    width: usize,
    height: usize,
    sum: Vec<f32>,
    n: usize,
}

impl Mean {
    /// The sum of one image.
    pub fn new(first: &Image) -> Self {
        let sum = values(first).collect();
        Self { width: first.width(), height: first.height(), sum, n: 1 }
    }

    /// Adds an image. `false`, and nothing is added, when it has another size.
    pub fn add(&mut self, image: &Image) -> bool {
        let fits = (image.width(), image.height()) == (self.width, self.height);
        if fits {
            self.sum.iter_mut().zip(values(image)).for_each(|(sum, v)| *sum += v);
            self.n += 1;
        }
        fits
    }

    /// Number of images.
    pub fn len(&self) -> usize {
        self.n
    }

    /// Never: it holds at least one image.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The mean, as floats in the scale of the images. Sums of up to 256 images of whole numbers are exact.
    ///
    /// ```
    /// use quadrille::imaging::{Image, Mean, Pixels};
    /// let image = |levels: [u8; 2]| Image::new(2, 1, Pixels::U8(levels.into())).unwrap();
    /// let mut mean = Mean::new(&image([10, 20]));
    /// assert!(mean.add(&image([11, 24])));
    /// assert_eq!(*mean.image().pixels(), Pixels::F32(vec![10.5, 22.0]));
    /// ```
    pub fn image(self) -> Image {
        let n = self.n as f32;
        let mean = self.sum.into_iter().map(|sum| sum / n).collect();
        let image = Image::new(self.width, self.height, Pixels::F32(mean));
        image.unwrap_or_else(|error| unreachable!("the mean of images is one: {error}"))
    }
}

fn values(image: &Image) -> Box<dyn Iterator<Item = f32> + '_> {
    match image.pixels() {
        Pixels::U8(levels) => Box::new(levels.iter().map(|&v| v.into())),
        Pixels::U16(levels) => Box::new(levels.iter().map(|&v| v.into())),
        Pixels::F32(levels) => Box::new(levels.iter().copied()),
    }
}

/// Translation that carries `f` onto `g`, px: one Gauss-Newton step over the whole image (THEORY 2 with two unknowns
/// and an offset of brightness), the gradient being the mean of both images' central differences, which makes the
/// error of second order. Good for shifts below a pixel; `None` for images of different sizes, below 3 x 3 px, or without
/// texture in both directions.
///
/// ```
/// use quadrille::imaging::{Image, Pixels, small_shift};
/// let wave = |u: f32| {
///     let level = |at: i32| 100.0 + 40.0 * ((at % 64) as f32 - u).mul_add(0.3, 0.0).sin() + 40.0 * (0.25 * (at / 64) as f32).sin();
///     Image::new(64, 64, Pixels::F32((0..4096).map(level).collect())).unwrap()
/// };
/// let [x, y] = small_shift(&wave(0.0), &wave(0.2)).unwrap();
/// assert!((x - 0.2).abs() < 0.01 && y.abs() < 0.01);
/// ```
pub fn small_shift(f: &Image, g: &Image) -> Option<[f64; 2]> {
    let (width, height) = (f.width(), f.height());
    if (g.width(), g.height()) != (width, height) || width < 3 || height < 3 {
        return None;
    }
    // Sums of the normal equations with the offset eliminated: n, and those of gx, gy, r and their products.
    let (mut n, mut first, mut second) = (0.0, [0.0; 3], [0.0; 5]);
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let both = |x: usize, y: usize| f64::from(f.grey(x, y)) + f64::from(g.grey(x, y));
            let gx = (both(x + 1, y) - both(x - 1, y)) / 4.0;
            let gy = (both(x, y + 1) - both(x, y - 1)) / 4.0;
            let r = f64::from(f.grey(x, y)) - f64::from(g.grey(x, y));
            n += 1.0;
            for (sum, v) in first.iter_mut().zip([gx, gy, r]) {
                *sum += v;
            }
            for (sum, v) in second.iter_mut().zip([gx * gx, gx * gy, gy * gy, gx * r, gy * r]) {
                *sum += v;
            }
        }
    }
    let [sx, sy, sr] = first;
    let [xx, xy, yy, xr, yr] = second;
    let (xx, xy, yy) = (xx - sx * sx / n, xy - sx * sy / n, yy - sy * sy / n);
    let (xr, yr) = (xr - sx * sr / n, yr - sy * sr / n);
    let determinant = xx * yy - xy * xy;
    if !(determinant > 1e-6 * xx * yy) {
        return None;
    }
    Some([(yy * xr - xy * yr) / determinant, (xx * yr - xy * xr) / determinant])
}
