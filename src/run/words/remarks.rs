//! What a run has to say of its files, its device, its mesh and its frames; of a whole series see
//! [`crate::run::words::doubts`].

use crate::backend::BackendError;
use crate::camera::{Rectifier, USUAL_DISTANCE, USUAL_DISTORTION};
use crate::correlate::{BareBorder, Correlation, NoiseColour, Reference, StartUsed, TextureFault, UpdateRefused};
use crate::field::Status;
use crate::imaging::{GreyDepth, Image, Levels, OddLevels, Saturation};
use crate::io::case::{CaseCamera, CaseZone};
use crate::io::images::Foreign;
use crate::io::load::clock_time;
use crate::io::series::{NameOrder, TwoCameras, natural_order};
use crate::io::text::shell_word;
use crate::mechanics::PathEnd;
use crate::remark::{About, Code, Remark};
use crate::report::saturated;
use crate::report::summary::{FrameSummary, STILL};
use crate::run::words::{chain, plural, ranges};
use std::path::{Path, PathBuf};

/// What is not known of the camera of a series.
pub(crate) fn of_camera(
    camera: &Rectifier,
    camera_of_case: Option<&CaseCamera>,
    frames: &[FrameSummary],
) -> impl Iterator<Item = Remark> {
    let said = [
        of_lens(camera, camera_of_case, frames),
        of_other_day(camera_of_case, frames),
        of_scale(camera_of_case, frames),
    ];
    said.into_iter().flatten()
}

/// A strain that may as well be a change of the distance, of which nothing is stated.
fn of_scale(camera_of_case: Option<&CaseCamera>, frames: &[FrameSummary]) -> Option<Remark> {
    /// In changes of the distance that are usual, and in the budget of every interval.
    const MORE: f64 = 3.0;
    let is_stated = |camera: &CaseCamera| {
        camera.still.is_some()
            || camera.telecentric == Some(true)
            || camera.distance_std.is_some()
            || camera.exact == Some(true)
    };
    if camera_of_case.is_some_and(is_stated) {
        return None;
    }
    let strains = frames.iter().filter(|frame| frame.status.is_measured()).filter_map(|frame| {
        let is_of_ground = frame.zones.iter().any(|zone| zone.name == STILL);
        Some((frame.uniform_strain?, frame.number, is_of_ground))
    });
    let (strain, number, is_of_ground) = strains.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
    let what = if is_of_ground { format!("the zone '{STILL}'") } else { "all that is measured".to_owned() };
    let grow = if strain > 0.0 { "grow" } else { "shrink" };
    let text = format!(
        "{what} seems to {grow} by {:.0} microstrain alike in all directions (frame {number}): heat or two equal loads, or a \
         distance to the camera that changed by as much; name zones that do not deform in `[camera] still`, or state \
         `distance_std`",
        1e6 * strain.abs()
    );
    let remark = Remark::new(Code::ScaleChanged, About::Run, text).with("strain", strain);
    (strain.abs() > MORE * USUAL_DISTANCE).then(|| remark.with("frame", number as f64))
}

/// What a usual lens adds to a series whose camera is not stated: only where it is more than the noise of a node.
///
/// Displacements seem to differ by up to `3 q d (r/R)^2` and strains to be up to `6 q d r/R^2` for a distortion `q` at
/// the corner, at the distance `R` from the centre; `d` is the largest rigid motion, `r` reaches to the node furthest
/// from the centre (THEORY 22).
fn of_lens(camera: &Rectifier, camera_of_case: Option<&CaseCamera>, frames: &[FrameSummary]) -> Option<Remark> {
    if camera_of_case.is_some_and(|camera| camera.states_camera() || camera.exact == Some(true)) {
        return None;
    }
    let [width, height] = camera.camera().shape().image_size_px.map(|n| n as f64 - 1.0);
    let (half, middle) = (0.5 * width.hypot(height), [0.5 * width, 0.5 * height]);
    let reach = camera
        .mesh()
        .nodes()
        .iter()
        .fold(0.0f64, |most, &node| most.max((node[0] - middle[0]).hypot(node[1] - middle[1])));
    let measured = frames.iter().filter(|frame| frame.status.is_measured());
    let motion = |frame: &FrameSummary| {
        let rigid = frame.rigid_motion.as_ref()?;
        let turn = rigid.rotation_deg.to_radians().abs() * reach;
        Some(rigid.translation_px[0].hypot(rigid.translation_px[1]) + turn)
    };
    let largest = measured.clone().filter_map(motion).fold(0.0, f64::max);
    let noise = measured.filter_map(|frame| frame.model_error.as_ref()).map(|of| of.sigma_rms_px);
    let sigma = noise.fold(f64::INFINITY, f64::min);
    let share = reach / half;
    let displacement = 3.0 * USUAL_DISTORTION * largest * share * share;
    let strain = 6.0 * USUAL_DISTORTION * largest * share / half;
    let text = format!(
        "the camera is not stated: a usual lens (0.1 % at the corner) adds up to {displacement:.2} px and {:.0} microstrain to \
         this series, which moves by {largest:.1} px; `quadrille calibrate`, or `[camera] exact = true`",
        1e6 * strain
    );
    let remark = Remark::new(Code::LensUnknown, About::Run, text).with("displacement_px", displacement);
    (displacement > sigma).then(|| remark.with("strain", strain))
}

/// Images that were taken on another day than those of the calibration.
fn of_other_day(camera_of_case: Option<&CaseCamera>, frames: &[FrameSummary]) -> Option<Remark> {
    /// Seconds.
    const DAY: f64 = 86400.0;
    let calibrated = camera_of_case?.taken.as_deref()?;
    let taken = frames.iter().find_map(|frame| frame.taken.as_deref())?;
    let days = (clock_time(taken)? - clock_time(calibrated)?) / DAY;
    let text = format!(
        "the images were taken {} days {} those of the calibration ({calibrated}): calibrate again if lens, focus or distance \
         may have changed",
        days.abs().round(),
        if days > 0.0 { "after" } else { "before" }
    );
    let remark = Remark::new(Code::CameraOtherDay, About::Run, text);
    (days.abs() > 1.0).then(|| remark.with("days", days))
}

const FILES_NAMED: usize = 5;
const NODES_NAMED: usize = 3;

/// Files of the series that are text; `None` without any.
pub(crate) fn files_left_out(texts: &[PathBuf]) -> Option<Remark> {
    let are = if texts.len() == 1 { "is not an image and is left out" } else { "are not images and are left out" };
    left_out(texts, are)
}

/// Files that a pattern would take but for their capital letters; `None` without any.
pub(crate) fn but_for_capitals(files: &[PathBuf]) -> Option<Remark> {
    let are = "left out: only capital letters keep the pattern from taking";
    left_out(files, &if files.len() == 1 { format!("is {are} it") } else { format!("are {are} them") })
}

fn left_out(files: &[PathBuf], are: &str) -> Option<Remark> {
    let first = files.first()?;
    let named = |path: &PathBuf| match Foreign::at(path) {
        Some(foreign) => format!("{} ({})", path.display(), foreign.what),
        None => path.display().to_string(),
    };
    let mut names: Vec<String> = files.iter().take(FILES_NAMED).map(named).collect();
    if files.len() > FILES_NAMED {
        names.push(format!("{} more", files.len() - FILES_NAMED));
    }
    let remark = Remark::new(Code::FilesLeftOut, About::Run, format!("{} {are}", names.join(", ")));
    Some(remark.with("files", files.len()).with("first", first.display().to_string()))
}

/// The order that numbers with decimals, signs or units make of these files; `None` where it is the plain one.
pub(crate) fn order_of_names(files: &[PathBuf]) -> Option<Remark> {
    let (order, mut plain) = (NameOrder::of(files), files.to_vec());
    plain.sort_by(|a, b| natural_order(a, b));
    let is_by_numbers = files.is_sorted_by(|a, b| order.compare(a, b).is_le());
    let first: Vec<String> = files.iter().take(FILES_NAMED).map(|path| path.display().to_string()).collect();
    let more = if files.len() > FILES_NAMED { ", ..." } else { "" };
    let text =
        format!("order by the numbers in the names, with their decimals, signs and units: {}{more}", first.join(", "));
    (is_by_numbers && plain != files).then(|| Remark::new(Code::OrderOfNames, About::Run, text))
}

/// The images of two cameras, and what to do with them.
pub(crate) fn cameras_of(TwoCameras { names, patterns, certain }: &TwoCameras) -> String {
    let command = |name: &str, pattern: &str| {
        let folder = format!("out-{}", name.trim_matches(|c: char| !c.is_alphanumeric()));
        format!("`quadrille correlate --output {} {}`", shell_word(&folder), shell_word(pattern))
    };
    let ([first, second], [of_first, of_second]) = (names, patterns);
    let are = if *certain { "these are two cameras, and a series is of one:" } else { "if these are two cameras," };
    format!(
        "the names have {first} and {second} in turn, every instant has both; {are} give {}, then {}",
        command(first, of_first),
        command(second, of_second)
    )
}

/// The images may be those of two cameras.
pub(crate) fn cameras_mixed(found: &TwoCameras) -> Remark {
    let remark = Remark::new(Code::CamerasMixed, About::Run, cameras_of(found));
    let [first, second] = &found.patterns;
    remark.with("first", first.as_str()).with("second", second.as_str())
}

/// What there is to know of the file of frame `number`.
pub(crate) fn of_image(number: usize, notes: &[String]) -> Option<Remark> {
    (!notes.is_empty()).then(|| Remark::new(Code::ImageFile, About::Frames(vec![number]), notes.join("; ")))
}

/// Why an image of floats may not be found: its grey levels (or one hot pixel) span another scale than the `reference`.
pub(crate) fn another_scale(image: &Image, reference: (f32, f32)) -> Option<String> {
    const SCALE: f32 = 20.0;
    // Others have the scale of their type; their pixels are not looked through.
    let Levels::F32(_) = image.pixels() else { return None };
    let [own, other] = [image.range(), reference].map(|(low, high)| high - low);
    (!(1.0 / SCALE..SCALE).contains(&(own / other))).then(|| {
        format!(
            "its grey levels span {own:.4}, those of the reference {other:.4}: save all images on one scale, and without \
             pixels far beyond the others"
        )
    })
}

/// The same of a file of the reference.
pub(crate) fn of_reference(file: &str, note: &str) -> Remark {
    Remark::new(Code::ImageFile, About::Reference, format!("{file}: {note}"))
}

/// A further image of the reference that is shifted by `[x, y]` px against the first.
pub(crate) fn reference_blurred(file: &str, first: &str, [x, y]: [f64; 2]) -> Remark {
    let text = format!(
        "{file}: moved by about ({x:.2}, {y:.2}) px against {first}: their mean is blurred; take references between \
         which nothing moves"
    );
    Remark::new(Code::ReferenceBlurred, About::Reference, text).with("x_px", x).with("y_px", y)
}

/// The grey levels of the reference called `name`.
pub(crate) fn of_grey(name: &str, reference: &Image, saturation: Option<Saturation>) -> Vec<Remark> {
    let depth = GreyDepth::of(reference).and_then(GreyDepth::remark);
    let depth = depth.map(|text| Remark::new(Code::ImageFile, About::Reference, text));
    let odd = OddLevels::of(reference).map(|odd| Remark::new(Code::ImageOdd, About::Reference, odd.to_string()));
    let much = saturation.and_then(|found| saturated(About::Reference, found));
    depth.into_iter().chain(odd).chain(much).map(|remark| remark.after(&format!("{name}: "))).collect()
}

/// Pixels of the reference called `name` that stand alone; `None` without any.
pub(crate) fn hot_pixels(name: &str, n: usize) -> Option<Remark> {
    let (pixels, stand) = if n == 1 { ("1 pixel", "stands") } else { (&*format!("{n} pixels"), "stand") };
    let text = format!(
        "{name}: {pixels} of the zones {stand} alone, as hot and dead pixels do; where an image shows them as well, \
         their neighbours say what is there"
    );
    (n > 0).then(|| Remark::new(Code::HotPixels, About::Reference, text).with("pixels", n))
}

/// What there is to know of a mask or mesh file.
pub(crate) fn of_zone_file(path: &Path, note: &str) -> Remark {
    let file = path.display().to_string();
    let text = format!("{file}: {note}");
    Remark::new(Code::ZoneFile, About::File(file), text)
}

/// A device that was chosen for want of another.
pub(crate) fn of_device(text: String) -> Remark {
    Remark::new(Code::DeviceChosen, About::Device, text)
}

/// The device failed before the first frame.
pub(crate) fn device_unprepared(error: &BackendError) -> Remark {
    Remark::new(Code::DeviceFailed, About::Device, format!("{error}; the CPU does the work"))
}

/// The device failed at frame `number`; `fresh` where another one of it is tried.
pub(crate) fn device_failed(number: usize, error: &BackendError, fresh: bool) -> Remark {
    let then = if fresh { "trying once more on a fresh device" } else { "going on with the CPU" };
    let remark = Remark::new(Code::DeviceFailed, About::Device, format!("frame {number}: {error}; {then}"));
    remark.with("frame", number).with("goes_on_with", if fresh { "fresh device" } else { "cpu" })
}

/// The device measured another field of frame `number` than the CPU, which looks at every `looked_at`th.
pub(crate) fn device_wrong(number: usize, error: &BackendError, looked_at: usize) -> Remark {
    let before = match number {
        1 => String::new(),
        _ => format!("; nobody has looked at up to {looked_at} frames before it: measure them again"),
    };
    let text = format!("frame {number}: {error}; going on with the CPU{before}");
    Remark::new(Code::DeviceWrong, About::Device, text).with("frame", number)
}

/// The file system of `folder` has no locks.
pub(crate) fn no_locks(folder: &Path) -> Remark {
    let text = format!("{}: the file system has no locks; nothing keeps a second process away", folder.display());
    Remark::new(Code::NoLocks, About::Run, text)
}

/// The report, or `what` of it, is missing because of an error.
pub(crate) fn report_missing(what: &str, error: &dyn std::error::Error) -> Remark {
    Remark::new(Code::ReportMissing, About::Run, format!("{what}: {}", chain(error)))
}

/// No curves are drawn because of an error.
pub(crate) fn curves_missing(error: &dyn std::error::Error) -> Remark {
    let text = format!("no numbers are drawn from the fields: {}", chain(error));
    Remark::new(Code::CurvesMissing, About::Run, text)
}

/// `file` came after `last`, although it sorts before it.
pub(crate) fn frame_late(file: &Path, last: &Path) -> Remark {
    let [file, last] = [file, last].map(|path| path.display().to_string());
    let text = format!("{file} arrived after {last}, although its name sorts before it");
    Remark::new(Code::FrameLate, About::File(file), text).with("after", last)
}

pub(crate) fn folder_unreadable(folder: &Path, error: &dyn std::error::Error) -> Remark {
    let text = format!("{} cannot be listed: {error}", folder.display());
    Remark::new(Code::FolderUnreadable, About::Camera, text)
}

pub(crate) fn of_nodes(reference: &Reference) -> impl Iterator<Item = Remark> {
    let of = |code: Code, faults: &[TextureFault], what: &str| {
        let mut places: Vec<String> = faults.iter().take(NODES_NAMED).map(ToString::to_string).collect();
        if faults.len() > NODES_NAMED {
            places.push(format!("{} more in summary.json", faults.len() - NODES_NAMED));
        }
        let n = plural(faults.len(), "node");
        let about = || About::Nodes(faults.iter().take(NODES_NAMED).map(|fault| fault.node).collect());
        let text = || format!("{n} with too little texture {what}: {}", places.join("; "));
        (!faults.is_empty()).then(|| Remark::new(code, about(), text()).with("nodes", faults.len()))
    };
    let dropped = of(Code::NodesLeftOut, reference.dropped(), "left out");
    let held = of(Code::NodesHeld, reference.held(), "held by the nodes around them");
    [dropped, held].into_iter().flatten()
}

/// The strips of rectangles that whole elements of `size` px leave over, from 1 px on; `None` without any.
pub(crate) fn left_over(zones: &[CaseZone], size: usize) -> Option<Remark> {
    let of_zone = |(k, zone): (usize, &CaseZone)| {
        let has_outline = zone.polygon.is_some() || zone.mask.is_some() || zone.mesh.is_some();
        let is_rectangle = !has_outline && zone.elements.is_none() && zone.in_mm.is_none();
        let [x0, y0, x1, y1] = zone.roi.filter(|_| is_rectangle)?;
        // As the mesh is laid, within round-off.
        let [right, below] = [x1 - x0, y1 - y0].map(|length| (100.0 * ((length + 1e-6) % size as f64)).round() / 100.0);
        let name = zone.name_at(k);
        (right >= 1.0 || below >= 1.0).then(|| format!("{name}: {right} px at the right, {below} px below"))
    };
    let strips: Vec<String> = zones.iter().enumerate().filter_map(of_zone).collect();
    let text = format!("whole elements of {size} px leave strips over, which are not measured: {}", strips.join("; "));
    (!strips.is_empty()).then(|| Remark::new(Code::ZoneLeftOver, About::Reference, text))
}

/// A zone that ends at a place without texture and has no guard there.
pub(crate) fn of_border(border: &BareBorder) -> Remark {
    let BareBorder { zone, length_px, at: [x, y], is_within } = border;
    let (code, text) = match is_within {
        true => (
            Code::HoleBare,
            format!(
                "inside zone '{zone}' nodes are left out along {length_px:.0} px without texture (about ({x:.0}, \
                 {y:.0}) px): what lies there pulls the nodes beside it, and no guard reaches it; leave the place out \
                 of the zone (exclude, --mask, or no zone at all, so that it is found), with a guard of 3 px"
            ),
        ),
        false => (
            Code::BorderBare,
            format!(
                "zone '{zone}' borders on {length_px:.0} px without texture (about ({x:.0}, {y:.0}) px): what lies \
                 beyond is mixed into its outermost pixels and pulls the nodes there; leave these out with --guard 3 \
                 or guard_px"
            ),
        ),
    };
    let remark = Remark::new(code, About::Zone(zone.clone()), text);
    remark.with("length_px", *length_px).with("x_px", *x).with("y_px", *y)
}

/// Frame `number` is the first whose standard uncertainties are multiplied because its noise is not white.
pub(crate) fn noise_correlated(number: usize, colour: &NoiseColour) -> Remark {
    let text = format!("frame {number}: {colour} (every frame has its own: noise_correlation_factor)");
    let [x, y] = colour.factor.map(|factor| factor.max(1.0));
    Remark::new(Code::NoiseCorrelated, About::Frames(vec![number]), text).with("factor_x", x).with("factor_y", y)
}

/// A frame that was begun where those before led to.
pub(crate) fn of_tracking(number: usize, result: &Correlation) -> Option<Remark> {
    let (code, text) = match (result.measurement.status, result.start) {
        (Status::Converged | Status::PartlyLost, StartUsed::Cold) => {
            (Code::TrackingRestarted, "the start from the frames before failed; searched for without them")
        }
        (Status::Converged | Status::PartlyLost, _) => return None,
        _ => (Code::TrackingLost, "neither the start from the frames before nor a search without them converged"),
    };
    Some(Remark::new(code, About::Frames(vec![number]), text))
}

/// Frame `number` was not measured from the frame that might have become its reference.
pub(crate) fn reference_refused(number: usize, refused: &UpdateRefused) -> Remark {
    Remark::new(Code::ReferenceRefused, About::Frames(vec![number]), chain(refused))
}

pub(crate) fn zones_found(text: String) -> Remark {
    Remark::new(Code::ZonesFound, About::Reference, text)
}

/// Where a crack was found, or why none was.
pub(crate) fn of_crack_search(text: String) -> Remark {
    Remark::new(Code::CrackFound, About::Run, text)
}

pub(crate) fn zones_matched(note: &str) -> Remark {
    Remark::new(Code::ZonesMatched, About::Joint, note)
}

pub(crate) fn figure_missing(instant: usize) -> Remark {
    let text = format!("[output] figures names instant {instant}, which has no solution");
    Remark::new(Code::FigureMissing, About::Instants(vec![instant]), text)
}

/// A path goes back at `n` of `of` points, from `first` to `last`.
pub(crate) fn path_goes_back(n: usize, of: usize, [first, last]: [usize; 2]) -> Remark {
    let text = format!(
        "the path goes back at {n} of its {of} points, between instants {first} and {last}: no test shows it there, \
         it snaps over them"
    );
    Remark::new(Code::PathGoesBack, About::Joint, text).with("points", n).with("first", first).with("last", last)
}

/// A path ended after `points` at `at` of the instants of the case; `None` at the last of them.
pub(crate) fn path_ended(end: PathEnd, points: usize, at: f64, n_instants: usize) -> Option<Remark> {
    let (how, text) = match end {
        PathEnd::Last => return None,
        PathEnd::Rest => ("rest", "the path comes back to rest: the joint is broken".to_owned()),
        PathEnd::Lost => {
            let text =
                format!("the path is lost at {at:.4} of {n_instants} instants of the case; try a smaller [path] step");
            ("lost", text)
        }
        PathEnd::Points => {
            let text = format!(
                "the path ends after {points} points at {at:.4} of {n_instants} instants of the case; max_points of \
                 [path] allows more"
            );
            ("points", text)
        }
    };
    Some(Remark::new(Code::PathEnded, About::Joint, text).with("end", how).with("points", points).with("at", at))
}

/// Frames by their numbers, as words.
pub(crate) fn name_frames(numbers: &[usize]) -> String {
    if let [number] = numbers { format!("frame {number}") } else { format!("frames {}", ranges(numbers)) }
}

/// The same with their verb.
pub(crate) fn name_frames_are(numbers: &[usize]) -> String {
    format!("{} {}", name_frames(numbers), if numbers.len() == 1 { "is" } else { "are" })
}

#[cfg(test)]
mod tests {
    use super::another_scale;
    use crate::imaging::{Image, Pixels};

    #[test]
    fn floats_on_another_scale_than_the_reference_are_said_and_levels_of_a_type_are_not() {
        let image = |pixels| Image::new(2, 1, pixels).unwrap();
        let said = |span: f32, reference| another_scale(&image(Pixels::F32(vec![0.0, span])), (0.0, reference));
        // 0 to 1 beside 16 bit, and one hot pixel; a twentieth of the contrast is still light.
        assert!(said(1.0, 65535.0).is_some_and(|text| text.contains("span 1.0000, those of the reference 65535")));
        assert!(said(1e6, 255.0).is_some() && said(13.0, 255.0).is_none() && said(255.0, 255.0).is_none());
        assert!(another_scale(&image(Pixels::U8(vec![0, 1])), (0.0, 65535.0)).is_none());
    }
}
