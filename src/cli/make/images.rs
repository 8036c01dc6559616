//! `quadrille make images`.

use crate::cli::args::{Bits, Field, ImagesArgs};
use crate::cli::{Outcome, Result};
use crate::io::images::write_image;
use crate::run::{RunError, write_file};
use crate::synth::{
    Accuracy, Affine, Depth, Motion, Peel, RenderOptions, Rotation, Series, Sinusoids, Star, Texture, Translation,
};
use serde_json::json;
use std::fs;
use std::path::Path;

pub(crate) fn run(args: &ImagesArgs) -> Result<Outcome> {
    let [width, height] = args.size;
    let finite = |name: &str, value: f64| {
        if value.is_finite() { Ok(value) } else { Err(format!("{name} is {value}; give a number")) }
    };
    let amplitude = |default: f64| finite("--amplitude", args.amplitude.unwrap_or(default));
    let wavelength = || match args.wavelength {
        value if value.is_finite() && value > 0.0 => Ok(value),
        value => Err(format!("--wavelength is {value}; give a positive number of pixels")),
    };
    let [a, b, c, d] = args.gradient;
    match args.field {
        Field::Translation => make(args, Translation(args.shift)),
        Field::Rotation => make(args, Rotation::new(finite("--degrees", args.degrees)?, width, height)),
        Field::Affine => make(args, Affine::new([[a, b], [c, d]], width, height)),
        Field::Sinusoids => make(args, Sinusoids { amplitude: amplitude(1.0)?, wavelength: wavelength()? }),
        Field::Accuracy => make(args, Accuracy::new(width, height)),
        Field::Star => {
            let star = Star::new(width, height);
            make(args, Star { amplitude: amplitude(0.5)?, periods: [10.0, 300.0], ..star })
        }
        Field::Peel => {
            let (opening_px, slide_px) = (finite("--opening", args.opening)?, finite("--slide", args.slide)?);
            let peel = Peel { opening_px, slide_px, ..Peel::new(width, height) };
            let outcome = make(args, peel)?;
            // Three pixels off the band: its pixels would be mixed into those of the faces.
            let (upper, lower) = ((peel.upper_edge() - 3.0).floor(), (peel.lower_edge() + 3.0).ceil());
            args.talk.say(format_args!("the strips: --roi 0,0,{width},{upper} --roi 0,{lower},{width},{height}"));
            Ok(outcome)
        }
    }
}

fn make<M: Motion>(args: &ImagesArgs, motion: M) -> Result<Outcome> {
    let [width, height] = args.size;
    if args.grid == 0 {
        return Err("--grid is 0; give the distance of the points in pixels".into());
    }
    let depth = match args.bits {
        Bits::Eight => Depth::U8,
        Bits::Sixteen => Depth::U16,
        Bits::Float => Depth::F32,
    };
    let options = RenderOptions { depth, noise: args.noise, seed: args.seed, ..RenderOptions::new(width, height) };
    let series = Series { texture: Texture::new(args.seed, args.speckle)?, motion, n_frames: args.frames, options };
    if args.output.join("synth.json").exists() && !args.overwrite {
        return Err(format!(
            "{}: holds another set of images; choose another --output folder, or replace them with --overwrite",
            args.output.display()
        )
        .into());
    }
    remove_further(&args.output, args.frames)?;
    write_series(&series, &args.output, args.grid)?;
    let about = json!({
        "quadrille": env!("CARGO_PKG_VERSION"),
        "field": format!("{:?}", args.field).to_lowercase(),
        "frames": args.frames,
        "size_px": args.size,
        "bits": format!("{:?}", depth),
        "noise_grey": args.noise,
        "seed": args.seed,
        "speckle_px": args.speckle,
        "shift_px": args.shift, "degrees": args.degrees, "gradient": args.gradient,
        "amplitude_px": args.amplitude, "wavelength_px": args.wavelength,
        "opening_px": args.opening, "slide_px": args.slide,
        "frame_of_reference": "x right, y down, origin at the centre of the top-left pixel; u on reference coordinates",
    });
    write_file(&args.output.join("synth.json"), format!("{about:#}\n"))?;
    args.talk.say(format_args!(
        "{} images and their exact displacements in {}",
        args.frames + 1,
        args.output.display()
    ));
    Ok(Outcome::Fine)
}

/// Writes the images `NNNNNN.tif` and `exact/NNNNNN.csv`, the displacement at points `grid` px apart.
pub(crate) fn write_series<M: Motion>(series: &Series<M>, folder: &Path, grid: usize) -> Result<()> {
    let exact = folder.join("exact");
    fs::create_dir_all(&exact).map_err(|error| RunError::file(&exact, "written", error))?;
    let RenderOptions { width, height, .. } = series.options;
    let points: Vec<[f64; 2]> =
        (0..=height).step_by(grid).flat_map(|y| (0..=width).step_by(grid).map(move |x| [x as f64, y as f64])).collect();
    for frame in 0..=series.n_frames {
        write_image(&folder.join(format!("{frame:06}.tif")), &series.image(frame)?)?;
        if frame == 0 {
            continue;
        }
        let mut text = String::from("# exact displacement, px; x right, y down, on reference coordinates\n");
        text.push_str("x_px,y_px,ux_px,uy_px\n");
        for (x, u) in points.iter().zip(series.exact_at(frame, &points)) {
            text.push_str(&format!("{},{},{:?},{:?}\n", x[0], x[1], u[0], u[1]));
        }
        write_file(&exact.join(format!("{frame:06}.csv")), text)?;
    }
    Ok(())
}

/// Removes the images that an earlier, longer series left behind: a glob would take them along.
fn remove_further(folder: &Path, n_frames: usize) -> Result<()> {
    for frame in n_frames + 1.. {
        let image = folder.join(format!("{frame:06}.tif"));
        if !folder.join("synth.json").exists() || !image.exists() {
            break;
        }
        for path in [image, folder.join(format!("exact/{frame:06}.csv"))] {
            fs::remove_file(&path).map_err(|error| RunError::file(&path, "written", error))?;
        }
    }
    Ok(())
}
