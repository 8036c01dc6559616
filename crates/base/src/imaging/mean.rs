//! The mean of several images, and how far they have moved between them.

use super::{Image, Levels, Pixels};

/// Rows that are enough to find a shift.
const ROWS: usize = 256;

/// A sum of images of one size.
#[derive(Debug, Clone)]
pub struct Mean {
    width: usize,
    height: usize,
    /// `f64`: no number of `f32` grey levels overflows it.
    sum: Vec<f64>,
    n: usize,
}

impl Mean {
    /// The sum of one image.
    pub fn new(first: &Image) -> Self {
        let (width, height) = (first.width(), first.height());
        Self { width, height, sum: first.pixels().floats(0..width * height).into_iter().map(f64::from).collect(), n: 1 }
    }

    /// Adds an image. `false`, and nothing is added, when it has another size.
    pub fn add(&mut self, image: &Image) -> bool {
        let fits = (image.width(), image.height()) == (self.width, self.height);
        if fits {
            match image.pixels() {
                Levels::U8(levels) => self.sum.iter_mut().zip(levels).for_each(|(sum, &v)| *sum += f64::from(v)),
                Levels::U16(levels) => self.sum.iter_mut().zip(levels).for_each(|(sum, &v)| *sum += f64::from(v)),
                Levels::F32(levels) => self.sum.iter_mut().zip(levels).for_each(|(sum, &v)| *sum += f64::from(v)),
            }
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

    /// The mean, as floats in the scale of the images. Sums of whole numbers are exact.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{Image, Mean, Pixels};
    /// let image = |levels: [u8; 2]| Image::new(2, 1, Pixels::U8(levels.into())).unwrap();
    /// let mut mean = Mean::new(&image([10, 20]));
    /// assert!(mean.add(&image([11, 24])));
    /// assert_eq!(mean.image().pixels(), Pixels::F32(vec![10.5, 22.0]));
    /// ```
    pub fn image(self) -> Image {
        let n = self.n as f64;
        let mean = self.sum.into_iter().map(|sum| (sum / n) as f32).collect();
        // Between the smallest and the largest of the images' grey levels, so finite.
        let image = Image::new(self.width, self.height, Pixels::F32(mean));
        image.unwrap_or_else(|error| unreachable!("the mean of images is one: {error}"))
    }
}

/// Translation that carries `f` onto `g`, px: one Gauss-Newton step over some 256 rows of the image (THEORY 2 with two
/// unknowns and an offset of brightness), the gradient being the mean of both images' central differences, which makes
/// the error of second order. Good for shifts below a pixel; `None` for images of different sizes, below 3 x 3 px, or
/// without texture in both directions.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::imaging::{Image, Pixels, small_shift};
/// let wave = |u: f32| {
///     let level = |at: i32| 100.0 + 40.0 * (0.3 * ((at % 64) as f32 - u)).sin() + 40.0 * (0.25 * (at / 64) as f32).sin();
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
    for y in (1..height - 1).step_by((height / ROWS).max(1)) {
        let rows = |image: &Image| [y - 1, y, y + 1].map(|y| image.pixels().floats(y * width..(y + 1) * width));
        let ([fa, fb, fc], [ga, gb, gc]) = (rows(f), rows(g));
        n += (width - 2) as f64;
        for x in 1..width - 1 {
            let gx = f64::from((fb[x + 1] - fb[x - 1]) + (gb[x + 1] - gb[x - 1])) / 4.0;
            let gy = f64::from((fc[x] - fa[x]) + (gc[x] - ga[x])) / 4.0;
            let r = f64::from(fb[x] - gb[x]);
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
    if determinant.is_nan() || determinant <= 1e-6 * xx * yy {
        return None;
    }
    Some([(yy * xr - xy * yr) / determinant, (xx * yr - xy * xr) / determinant])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_the_largest_grey_levels_is_an_image() {
        let image = Image::new(1, 1, Pixels::F32(vec![f32::MAX])).unwrap();
        let mut mean = Mean::new(&image);
        assert!((0..3).all(|_| mean.add(&image)));
        assert_eq!(mean.image().pixels(), image.pixels());
    }
}
