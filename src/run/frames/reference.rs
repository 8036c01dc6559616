//! The reference of a run, and what is to be said of it.

use crate::correlate::CorrelationError;
use crate::field::Noise;
use crate::imaging::{Image, Mean, OddLevels, small_shift};
use crate::io::case::{CaseGuard, CaseZone};
use crate::io::images::{Accepted, ReadError};
use crate::io::series::Frame;
use crate::mesh::{Mesh, MeshError};
use crate::remark::Remark;
use crate::run::plan::Plan;
use crate::run::words::remarks::{of_reference, reference_blurred};
use crate::run::words::{Result, RunError, chain};
use crate::units::Px;
use std::path::Path;

/// The reference image, or the mean of several.
pub(crate) struct Reference {
    pub image: Image,
    /// Of each file.
    pub sha256: Vec<String>,
    /// What is worth knowing, each with its file.
    pub remarks: Vec<Remark>,
}

impl Reference {
    /// References further apart than this are said to have moved, px: averaging them blurs the texture.
    const STILL_PX: f64 = 0.02;

    /// The reference of `plan`.
    pub fn of(plan: &Plan) -> Result<Self> {
        Self::read(&plan.reference, plan.accepted).map_err(|error| match error {
            RunError::Image(fault @ (ReadError::NotAnImage { .. } | ReadError::Foreign(..))) if !plan.reference_named => {
                RunError::Reference(format!(
                    "{fault}. It comes first and is therefore taken for the reference: name the images alone, such as 'folder/*.tif', \
                     or say which is the reference with --reference"
                ))
            }
            error => error,
        })
    }

    /// Reads the images, and their mean when there are several.
    pub fn read(frames: &[Frame], accepted: Accepted) -> Result<Self> {
        let mut first: Option<(Image, &Frame)> = None;
        let mut mean: Option<Mean> = None;
        let (mut sha256, mut remarks) = (Vec::new(), Vec::new());
        for frame in frames {
            let loaded = frame.read(accepted)?;
            sha256.push(loaded.sha256);
            remarks.extend(loaded.notes.iter().map(|note| of_reference(&frame.to_string(), note)));
            let Some((before, name)) = &first else {
                first = Some((loaded.image, frame));
                continue;
            };
            let mean = mean.get_or_insert_with(|| Mean::new(before));
            if !mean.add(&loaded.image) {
                let size = |image: &Image| format!("{} x {} px", image.width(), image.height());
                let [own, first] = [&loaded.image, before].map(size);
                let what =
                    format!("the image is {own}, the reference {name} {first}; the mean needs images of one size");
                return Err(format!("{frame}: {what}").into());
            }
            if let Some([x, y]) = small_shift(before, &loaded.image)
                && x.hypot(y) > Self::STILL_PX
            {
                remarks.push(reference_blurred(&frame.to_string(), &name.to_string(), [x, y]));
            }
        }
        let (first, of) = first.ok_or("no reference image is given")?;
        has_room(&first, of)?;
        let image = mean.map_or(first, Mean::image);
        Ok(Self { image, sha256, remarks })
    }
}

/// Bytes per pixel of the image that no correlation does without, however small its zone: images, coefficients and the
/// search of a start (15 measured with the program itself).
const LEAST_BYTES: u128 = 15;

/// Refuses an image whose correlation this process cannot have the memory for: somewhere within, it would be ended
/// without a word of what to do.
fn has_room(image: &Image, of: &Frame) -> Result<()> {
    let bytes = LEAST_BYTES * image.width() as u128 * image.height() as u128;
    let is_allowed = memory_limit().is_none_or(|limit| bytes <= u128::from(limit));
    if is_allowed && usize::try_from(bytes).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok()) {
        return Ok(());
    }
    let (width, height) = (image.width() as u64, image.height() as u64);
    Err(ReadError::Memory { path: of.path.clone(), width, height, bytes }.into())
}

/// What the control group of this process lets it have, bytes; none where nothing limits it, or elsewhere than on Linux.
fn memory_limit() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let own = groups.lines().find_map(|line| line.strip_prefix("0::"));
    let number = |file: String| std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok();
    // A limit of any group above holds as well. Within a container the own one is seen as the root.
    let above = own.into_iter().flat_map(|own| Path::new(own.trim_start_matches('/')).ancestors());
    let version_2 = above.filter_map(|group| number(format!("/sys/fs/cgroup/{}/memory.max", group.display())));
    version_2.chain(number("/sys/fs/cgroup/memory/memory.limit_in_bytes".into())).min()
}

/// The rectangles that hold the zones, px: x0, y0, x1, y1.
pub(crate) fn windows(mesh: &Mesh<Px>) -> Vec<[usize; 4]> {
    let window = |zone: usize| {
        let bounds = mesh.bounds(zone);
        // Negative corners are cut at 0.
        [bounds.x0.ceil(), bounds.y0.ceil(), bounds.x1.ceil(), bounds.y1.ceil()].map(|v| v as usize)
    };
    (0..mesh.zones().len()).map(window).collect()
}

/// Size of the elements: the one asked for, or what the mesh of a file has.
pub(crate) fn element_size_px(mesh: &Mesh<Px>, asked: usize) -> f64 {
    let (size, asked) = (mesh.element_size(), asked as f64);
    // Grids that start at a fraction of a pixel miss it in the last digits.
    if (size - asked).abs() < 1e-9 * asked { asked } else { size }
}

/// Why the reference `image` cannot be prepared; its file is named when the fault may be in it.
pub(crate) fn about_reference(plan: &Plan, image: &Image, error: &CorrelationError) -> RunError {
    use MeshError::{
        CrossedPolygon, ElementShare, ElementSize, GuardSides, NoPolygon, NotARectangle, NotFinite, Overlap, SameName,
    };
    if let CorrelationError::NoTexture { .. } | CorrelationError::Textureless { .. } = error
        && let Some(odd) = OddLevels::of(image)
    {
        return RunError::Reference(format!("{}: no texture is found: {odd}", plan.reference_name()));
    }
    RunError::Reference(match error {
        CorrelationError::Option { .. }
        | CorrelationError::Backend(_)
        | CorrelationError::Mesh(
            ElementSize { .. }
            | ElementShare { .. }
            | NotARectangle { .. }
            | Overlap { .. }
            | SameName { .. }
            | NoPolygon { .. }
            | CrossedPolygon { .. }
            | NotFinite { .. }
            | GuardSides { .. },
        ) => chain(error),
        CorrelationError::NoTexture { .. } => {
            format!("{}: {}{}", plan.reference_name(), chain(error), perhaps_by_option(plan))
        }
        _ => format!("{}: {}", plan.reference_name(), chain(error)),
    })
}

/// What of the options takes texture away, where something may.
fn perhaps_by_option(plan: &Plan) -> String {
    let mut why = String::new();
    if let Noise::Constant(noise) = plan.options.noise {
        why.push_str(&format!(
            "; what is needed follows from the noise given, {noise} grey levels: is it that of the images?"
        ));
    }
    let of_zone = |zone: &CaseZone| match &zone.guard_px {
        Some(CaseGuard::All(guard) | CaseGuard::Along { width: guard, .. }) => *guard,
        Some(CaseGuard::Sides(sides)) => sides.iter().copied().fold(0.0, f64::max),
        Some(CaseGuard::Rectangle { left, top, right, bottom }) => left.max(*top).max(*right).max(*bottom),
        None => 0.0,
    };
    let guard = plan.zones.iter().map(of_zone).fold(plan.guard_px.unwrap_or(0.0), f64::max);
    let size = plan.options.element_size as f64;
    if guard >= 0.5 * size {
        why.push_str(&format!(
            "; the guard of {guard} px leaves {} of the elements of {size} px at the border: take a guard of a few px, or larger \
             elements",
            if guard >= size { "no pixel".to_owned() } else { format!("{:.0} % of the pixels", 100.0 * (1.0 - guard / size)) }
        ));
    }
    why
}
