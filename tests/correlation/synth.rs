//! The synthetic images: what they claim about texture, motion and noise is checked here.

use quadrille::imaging::{Image, Levels};
use quadrille::synth::{
    Accuracy, Affine, Depth, Motion, Peel, RenderOptions, Rotation, Series, Sinusoids, Star, SynthError, Texture,
    Translation, exact_at, inverse_at, render,
};

const SPECKLE_PX: f64 = 4.5;

fn texture() -> Texture {
    Texture::new(2024, SPECKLE_PX).unwrap()
}

fn float(width: usize, height: usize) -> RenderOptions {
    RenderOptions { depth: Depth::F32, ..RenderOptions::new(width, height) }
}

#[track_caller]
fn picture(motion: &impl Motion, options: &RenderOptions) -> Image {
    render(&texture(), motion, options).unwrap()
}

fn greys(image: &Image) -> Vec<f64> {
    (0..image.height()).flat_map(|y| (0..image.width()).map(move |x| f64::from(image.grey(x, y)))).collect()
}

fn mean_and_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// Points spread over an image, at irregular places.
fn points(width: usize, height: usize) -> Vec<[f64; 2]> {
    let golden = 0.618_033_988_749_895;
    (0..400).map(|k| [(k as f64 * golden).fract() * width as f64, k as f64 / 400.0 * height as f64]).collect()
}

/// Runs `check` on every motion, with its name.
fn for_each_motion(check: impl Fn(&str, &dyn Motion)) {
    let (width, height) = (640, 480);
    check("translation", &Translation([0.3, -7.7]));
    check("rotation", &Rotation::new(3.0, width, height));
    check("affine", &Affine::new([[0.01, 0.02], [-0.005, -0.01]], width, height));
    check("sinusoids", &Sinusoids { amplitude: 1.0, wavelength: 64.0 });
    check("accuracy", &Accuracy::new(width, height));
    check("star", &Star::new(width, height));
    check("peel", &Peel::new(width, height));
    check("peel half-way", &Peel::new(width, height).at(0.5));
}

#[test]
fn the_deformed_texture_at_x_plus_u_is_the_reference_texture_at_x() {
    // The map is solved to a few roundings of a coordinate: 1e-12 px, times 60 grey levels per pixel.
    let texture = texture();
    for_each_motion(|name, motion| {
        let mut points = points(640, 480);
        points.retain(|&x| (0..motion.n_bodies()).any(|body| motion.body_holds(body, x)));
        let moved: Vec<_> =
            points.iter().zip(exact_at(motion, &points)).map(|(x, u)| [x[0] + u[0], x[1] + u[1]]).collect();
        for (x, back) in points.iter().zip(inverse_at(motion, &moved).unwrap()) {
            let back = back.unwrap();
            let error = (x[0] - back[0]).abs().max((x[1] - back[1]).abs());
            assert!(error < 2e-12, "{name}: {x:?} comes back {error:e} px away");
            let difference = (texture.value(*x) - texture.value(back)).abs();
            assert!(difference < 1.2e-10, "{name}: grey level off by {difference:e} at {x:?}");
        }
    });
}

#[test]
fn a_pixel_sampled_at_its_centre_is_the_texture_at_its_material_point() {
    // Positions are rounded to 6e-8 px and sums are f32: together below 1e-4 grey levels.
    let texture = texture();
    for_each_motion(|name, motion| {
        let options = RenderOptions { points: 1, dark: 0.0, ..float(640, 480) };
        let image = render(&texture, motion, &options).unwrap();
        let mut worst = 0.0_f64;
        for y in (0..480).step_by(7) {
            for x in (0..640).step_by(5) {
                if let Some(material) = inverse_at(motion, &[[x as f64, y as f64]]).unwrap()[0] {
                    worst = worst.max((f64::from(image.grey(x, y)) - texture.value(material)).abs());
                } else {
                    assert_eq!(image.grey(x, y), 0.0, "{name}: texture in the dark at ({x}, {y})");
                }
            }
        }
        assert!(worst < 1e-4, "{name}: off by {worst:e} grey levels");
    });
}

#[test]
fn a_translation_by_whole_pixels_gives_the_same_bits() {
    let options = float(150, 117);
    let reference = picture(&Translation([0.0, 0.0]), &options);
    for (dx, dy) in [(1_usize, 0_usize), (17, 40), (32, 64)] {
        let moved = picture(&Translation([dx as f64, dy as f64]), &options);
        for y in dy..117 {
            for x in dx..150 {
                assert_eq!(moved.grey(x, y), reference.grey(x - dx, y - dy), "shift ({dx}, {dy}), pixel ({x}, {y})");
            }
        }
    }
}

#[test]
fn the_single_precision_kernel_serves_all_speckle_sizes() {
    for speckle_px in [2.0, 3.0, 6.5, 12.0, 32.0] {
        let texture = Texture::new(5, speckle_px).unwrap();
        let options = RenderOptions { points: 1, ..float(70, 40) };
        let image = render(&texture, &Translation([0.4, 0.7]), &options).unwrap();
        for (x, y) in [(0, 0), (35, 21), (69, 39), (31, 32), (32, 31)] {
            let want = texture.value([x as f64 - 0.4, y as f64 - 0.7]);
            let got = f64::from(image.grey(x, y));
            assert!((got - want).abs() < 1e-4, "{got} is not {want} at ({x}, {y}), speckle {speckle_px} px");
        }
    }
}

#[test]
fn the_texture_has_the_stated_statistics() {
    let n = 512;
    let image = picture(&Translation([0.0, 0.0]), &float(n, n));
    let values = greys(&image);
    let (mean, std) = mean_and_std(&values);
    // About 512^2 / 50 independent speckles: mean within 3 x 40/72, std within 3 %.
    assert!((mean - 120.0).abs() < 2.0, "mean {mean}");
    assert!((std - 40.0).abs() < 1.5, "standard deviation {std}");
    let clipped = values.iter().filter(|&&v| !(0.5..254.5).contains(&v)).count();
    assert_eq!(clipped, 0, "the texture stays within 8..232");

    let square = |dx: usize, dy: usize| {
        let mut sum = 0.0;
        for y in 1..n - 1 {
            for x in 1..n - 1 {
                let ahead = f64::from(image.grey(x + dx, y + dy));
                sum += (0.5 * (ahead - f64::from(image.grey(x - dx, y - dy)))).powi(2);
            }
        }
        (sum / ((n - 2) * (n - 2)) as f64).sqrt()
    };
    for rms_gradient in [square(1, 0), square(0, 1)] {
        assert!((12.0..18.0).contains(&rms_gradient), "rms gradient {rms_gradient}");
    }

    // Full width at half maximum of the autocorrelation, sqrt(2) times that of a blob.
    let correlation = |lag: usize| {
        let mut sum = 0.0;
        for y in 0..n {
            for x in 0..n - lag {
                sum += (values[y * n + x] - mean) * (values[y * n + x + lag] - mean);
            }
        }
        sum / (n * (n - lag)) as f64 / (std * std)
    };
    let lag = (1..20).find(|&lag| correlation(lag) < 0.5).unwrap();
    let (before, after) = (correlation(lag - 1), correlation(lag));
    let half_width = (lag - 1) as f64 + (before - 0.5) / (before - after);
    let speckle = 2.0 * half_width / 2.0_f64.sqrt();
    // Pixel integration and saturation widen it by a few per cent; sampling scatter is 2 %.
    assert!((speckle - SPECKLE_PX).abs() < 0.1 * SPECKLE_PX, "mean speckle size {speckle} px");
    assert!(correlation(20).abs() < 0.05, "speckles 20 px apart are independent");
}

#[test]
fn the_texture_is_alike_everywhere_and_of_every_seed() {
    for seed in 0..4 {
        let texture = Texture::new(seed, SPECKLE_PX).unwrap();
        for [ox, oy] in [[0.0, 0.0], [-1000.0, 300.0], [1e5, -1e6]] {
            let values: Vec<_> = (0..40_000)
                .map(|k| texture.value([ox + 1.7 * (k % 200) as f64, oy + 1.7 * (k / 200) as f64]))
                .collect();
            let (mean, std) = mean_and_std(&values);
            // 340 px squared hold about 2300 speckles: scatter of the mean 0.8, of the std 0.6.
            assert!((mean - 120.0).abs() < 3.5 && (std - 40.5).abs() < 2.5, "seed {seed}: mean {mean}, std {std}");
        }
    }
}

#[test]
fn another_seed_gives_another_texture_and_other_noise() {
    let options = float(64, 64);
    let [a, b] = [1, 2].map(|seed| {
        greys(&render(&Texture::new(seed, SPECKLE_PX).unwrap(), &Translation([0.0; 2]), &options).unwrap())
    });
    let alike = a.iter().zip(&b).filter(|(a, b)| (*a - *b).abs() < 1e-3).count();
    assert!(alike < 10, "{alike} equal pixels");

    let noisy =
        |seed, frame| picture(&Translation([0.0; 2]), &RenderOptions { noise: 2.0, seed, frame, ..float(64, 64) });
    assert_ne!(noisy(1, 0), noisy(2, 0));
    assert_ne!(noisy(1, 0), noisy(1, 1));
    assert_eq!(noisy(1, 1), noisy(1, 1));
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let options = RenderOptions { noise: 1.5, ..float(200, 170) };
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (picture(&Accuracy::new(200, 170), &options), picture(&Peel::new(200, 170), &options)))
    };
    assert_eq!(with(1), with(2));
    assert_eq!(with(2), with(3));
}

#[test]
fn the_noise_has_the_stated_standard_deviation_in_every_depth() {
    for (depth, scale, rounding) in [(Depth::F32, 1.0, 0.0), (Depth::U16, 257.0, 0.0), (Depth::U8, 1.0, 1.0 / 12.0)] {
        let clean = RenderOptions { depth, ..RenderOptions::new(256, 256) };
        let noisy = RenderOptions { noise: 2.0, ..clean };
        let [clean, noisy] = [clean, noisy].map(|options| greys(&picture(&Translation([0.0; 2]), &options)));
        let difference: Vec<_> = noisy.iter().zip(&clean).map(|(a, b)| (a - b) / scale).collect();
        let (mean, std) = mean_and_std(&difference);
        // Scatter of a standard deviation of 65536 draws: 2 / sqrt(131072) = 0.0055; rounding of both
        // images to whole grey levels adds 1/12 to the variance, twice.
        let want = (4.0_f64 + 2.0 * rounding).sqrt();
        assert!((std - want).abs() < 0.025, "{depth:?}: standard deviation {std}, not {want}");
        assert!(mean.abs() < 0.03, "{depth:?}: mean {mean}");
    }
}

#[test]
fn two_by_two_points_integrate_a_pixel_to_a_hundredth_of_a_grey_level() {
    // The error of the rule is h^4/4320 times the fourth derivatives, about 15 grey levels/px^4 rms and
    // some 200 where a steep flank saturates.
    let with = |points| greys(&picture(&Accuracy::new(256, 256), &RenderOptions { points, ..float(256, 256) }));
    let fine = with(6);
    for (points, rms_tolerance, tolerance) in [(2, 1e-2, 1e-1), (3, 2e-4, 2e-3)] {
        let difference: Vec<_> = with(points).iter().zip(&fine).map(|(a, b)| a - b).collect();
        let (_, rms) = mean_and_std(&difference);
        let worst = difference.iter().fold(0.0_f64, |worst, d| worst.max(d.abs()));
        assert!(rms < rms_tolerance, "{points} x {points} points: {rms:e} grey levels rms");
        assert!(worst < tolerance, "{points} x {points} points: off by {worst:e} grey levels");
    }
}

#[test]
fn depths_are_the_same_image_on_two_scales() {
    let at = |depth| picture(&Accuracy::new(80, 60), &RenderOptions { depth, ..RenderOptions::new(80, 60) });
    let (bytes, words, floats) = (at(Depth::U8), at(Depth::U16), at(Depth::F32));
    let (Levels::U8(bytes), Levels::U16(words), Levels::F32(floats)) =
        (bytes.pixels(), words.pixels(), floats.pixels())
    else {
        panic!("a depth was not kept");
    };
    for ((&byte, &word), &float) in bytes.iter().zip(words).zip(floats) {
        assert!(
            (f32::from(byte) - float).abs() <= 0.5 && (f32::from(word) / 257.0 - float).abs() <= 0.5 / 257.0 + 1e-4
        );
    }
}

#[test]
fn gradients_are_the_central_differences_of_displacements() {
    for_each_motion(|name, motion| {
        // Truncation h^2/6 u''' < 1e-9, round-off eps u/h < 1e-11.
        let h = 1e-3;
        for x in points(640, 480) {
            for body in 0..motion.n_bodies() {
                let gradient = motion.body_gradient(body, x);
                for axis in 0..2 {
                    let [mut low, mut high] = [x; 2];
                    low[axis] -= h;
                    high[axis] += h;
                    let [low, high] = [low, high].map(|x| motion.body_displacement(body, x));
                    for component in 0..2 {
                        let want = (high[component] - low[component]) / (2.0 * h);
                        let got = gradient[component][axis];
                        assert!(
                            (got - want).abs() < 1e-7,
                            "{name}: du_{component}/dx_{axis} = {got}, not {want}, at {x:?}"
                        );
                    }
                }
            }
        }
    });
}

#[test]
fn every_motion_starts_at_rest_and_ends_at_itself() {
    fn check<M: Motion + PartialEq + std::fmt::Debug>(motion: M) {
        let points = points(640, 480);
        let at_rest = exact_at(&motion.at(0.0), &points);
        assert!(at_rest.iter().flatten().all(|u| u.abs() < 1e-15), "{motion:?} does not start at rest");
        assert_eq!(motion.at(1.0), motion);
    }
    check(Translation([2.0, 3.0]));
    check(Rotation::new(10.0, 640, 480));
    check(Affine::new([[0.1, 0.2], [0.3, 0.4]], 640, 480));
    check(Sinusoids { amplitude: 1.0, wavelength: 50.0 });
    check(Accuracy::new(640, 480));
    check(Star::new(640, 480));
    check(Peel::new(640, 480));
}

#[test]
fn a_rotation_keeps_distances_and_turns_x_towards_y() {
    let rotation = Rotation::new(90.0, 101, 101);
    let u = rotation.displacement([60.0, 50.0]);
    assert!((u[0] + 10.0).abs() < 1e-13 && (u[1] - 10.0).abs() < 1e-13, "{u:?}");
}

#[test]
fn the_accuracy_field_is_the_documented_one() {
    let field = Accuracy::new(513, 257);
    let [x, y] = [100.0_f64, 30.0_f64];
    let (sin, cos) = 0.2_f64.to_radians().sin_cos();
    let [dx, dy] = [x - 256.0, y - 128.0];
    let wave = |x: f64| (std::f64::consts::TAU * x / 256.0).sin();
    let want = [wave(x) + 1.005 * cos * dx - sin * dy - dx, wave(y) + 1.005 * sin * dx + cos * dy - dy];
    let u = field.displacement([x, y]);
    // Round-off of numbers near 150.
    assert!((u[0] - want[0]).abs() < 1e-12 && (u[1] - want[1]).abs() < 1e-12, "{u:?} is not {want:?}");
}

#[test]
fn a_series_renders_its_reference_at_rest_and_each_frame_with_its_own_noise() {
    let options = RenderOptions { noise: 1.0, ..float(96, 64) };
    let series = Series { texture: texture(), motion: Accuracy::new(96, 64), n_frames: 4, options };
    assert_eq!(series.image(0).unwrap(), picture(&Translation([0.0; 2]), &options));
    let second = picture(&Accuracy::new(96, 64).at(0.5), &RenderOptions { frame: 2, ..options });
    assert_eq!(series.image(2).unwrap(), second);
    let points = points(96, 64);
    assert_eq!(series.exact_at(4, &points), exact_at(&Accuracy::new(96, 64), &points));
}

#[test]
fn the_peel_opens_from_the_right_and_its_front_moves_left() {
    let peel = Peel::new(1000, 800);
    let series = Series { texture: texture(), motion: peel, n_frames: 20, options: RenderOptions::new(1000, 800) };
    for k in 1..=20 {
        let (now, before) = (series.motion_at(k), series.motion_at(k - 1));
        assert!(now.front() < before.front());
        let mut last = -1.0;
        for x in (0..1000).step_by(50).map(f64::from) {
            let upper = now.displacement([x, peel.upper_edge() - 1e-9]);
            let lower = now.displacement([x, peel.lower_edge() + 1e-9]);
            let opening = lower[1] - upper[1];
            assert!((opening - now.opening(x)).abs() < 1e-9, "the jump is the opening");
            assert!(upper[1] < 0.0 && lower[1] > 0.0, "the upper strip moves up, the lower one down");
            assert!(opening > last && opening > before.opening(x), "opening {opening} at {x} in frame {k}");
            let slide = upper[0] - lower[0];
            assert!((slide - peel.slide_px * k as f64 / 20.0).abs() < 1e-9, "sliding {slide} in frame {k}");
            last = opening;
        }
    }
    assert!((peel.opening(1000.0) - 16.0).abs() < 1e-12);
    assert!(peel.opening(0.0) < 0.12 * peel.opening(1000.0));
}

#[test]
fn the_strains_of_the_peel_stay_below_their_bound() {
    let mut largest = 0.0_f64;
    for fraction in [0.1, 0.5, 1.0] {
        let peel = Peel::new(1000, 800).at(fraction);
        for x in points(1000, 800) {
            if !(0..2).any(|body| peel.body_holds(body, x)) {
                continue;
            }
            let [[xx, xy], [yx, yy]] = peel.gradient(x);
            let strain = xx.abs().max(yy.abs()).max((xy + yx).abs());
            assert!(strain <= peel.largest_strain() * (1.0 + 1e-12), "strain {strain} at {x:?}");
            largest = largest.max(strain);
        }
    }
    assert!(largest > 1e-4 && Peel::new(1000, 800).largest_strain() < 3e-3, "largest strain {largest}");
}

#[test]
fn the_band_of_the_peel_is_dark_and_follows_the_strips() {
    let (width, height) = (320, 240);
    for fraction in [0.0, 0.5, 1.0] {
        let peel = Peel::new(width, height).at(fraction);
        let image = picture(&peel, &float(width, height));
        for x in 0..width {
            let upper = peel.upper_edge() + peel.displacement([x as f64, peel.upper_edge() - 1e-9])[1];
            let lower = peel.lower_edge() + peel.displacement([x as f64, peel.lower_edge() + 1e-9])[1];
            let dark = |y: usize| (image.grey(x, y) - 12.0).abs() < 1e-5;
            // A column of the image holds material of a slightly different column: 2 px of margin.
            assert!((upper.ceil() as usize + 2..lower as usize - 2).all(dark), "texture in the band, column {x}");
            assert!(!(0..upper as usize - 2).any(dark) && !(lower.ceil() as usize + 2..height).any(dark));
        }
    }
}

#[test]
fn a_motion_without_gradient_is_rendered_by_differences() {
    struct Bulge;
    impl Motion for Bulge {
        fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
            let [dx, dy] = [x[0] - 40.0, x[1] - 40.0];
            let bell = (-(dx * dx + dy * dy) / 800.0).exp();
            [0.2 * dx * bell, 0.2 * dy * bell]
        }
        fn at(&self, _: f64) -> Self {
            Self
        }
    }
    let texture = texture();
    let image = render(&texture, &Bulge, &RenderOptions { points: 1, ..float(80, 80) }).unwrap();
    for x in [[10.0, 70.0], [33.0, 52.0]] {
        let material = inverse_at(&Bulge, &[x]).unwrap()[0].unwrap();
        let got = f64::from(image.grey(x[0] as usize, x[1] as usize));
        assert!((got - texture.value(material)).abs() < 1e-4);
    }
}

#[test]
fn what_cannot_be_rendered_is_an_error_that_says_why() {
    #[track_caller]
    fn assert_error<T: std::fmt::Debug>(got: Result<T, SynthError>, want: &str) {
        let message = got.unwrap_err().to_string();
        assert!(message.contains(want), "'{message}' does not say '{want}'");
    }
    let still = Translation([0.0, 0.0]);
    assert_error(Texture::new(1, 1.0), "speckle size is 1 px");
    assert_error(Texture::new(1, f64::NAN), "speckle size is NaN px");
    assert_error(render(&texture(), &still, &RenderOptions { noise: -1.0, ..float(8, 8) }), "noise is -1");
    assert_error(render(&texture(), &still, &RenderOptions { noise: f32::NAN, ..float(8, 8) }), "noise is NaN");
    assert_error(render(&texture(), &still, &RenderOptions { points: 0, ..float(8, 8) }), "0 points");
    assert_error(render(&texture(), &still, &RenderOptions { points: 7, ..float(8, 8) }), "7 points");
    assert_error(render(&texture(), &still, &float(0, 8)), "holds no pixel");
    assert_error(render(&texture(), &still, &float(usize::MAX / 4, 2)), "does not fit into the memory");
    assert_error(render(&texture(), &still, &float(usize::MAX / 4, 8)), "does not fit into the memory");
    let folding = Sinusoids { amplitude: 20.0, wavelength: 32.0 };
    assert_error(render(&texture(), &folding, &float(64, 64)), "folds");
    assert_error(render(&texture(), &Translation([f64::NAN, 0.0]), &float(8, 8)), "folds");
}
