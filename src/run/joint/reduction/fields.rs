//! What the fields of a run say of a reduced test (THEORY 23): load points, the tip, the crack, and the arms behind it.

use super::arms::{Arms, Beside, PATCH_ELEMENTS, weighed_sum};
use super::loads::{exact, of_machine, wrong};
use super::opened::{Opened, open};
use crate::camera::CameraTerm;
use crate::field::{FacingPoint, Jump, Measurement, NodalNoise, Quantities, RegionValues, Value};
use crate::io::case::{CaseFile, CaseReduction};
use crate::plane::{Point, cross, dot, minus};
use crate::reduction::{Instant, Layout, LoadedSection, Mode, Specimen, sections};
use crate::remark::{About, Code, Remark};
use crate::run::words::Result;
use crate::units::Px;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Angles of both arms that differ by this share of their sum are worth a word.
const UNEVEN: f64 = 0.1;
/// Places at the other end of the joint whose jump is taken together, and what makes it more than noise.
const END_PLACES: usize = 8;
const END_SEEN: f64 = 3.0;

/// What the fields of a run are asked for.
struct Asked<'a> {
    gauges: &'a Quantities,
    layout: Layout,
    /// Where the crack ends, and its initial length, mm.
    crack: Option<[f64; 2]>,
    sections: Vec<LoadedSection>,
    /// At the tip, the places of the joint beside it with their weights.
    at_tip: Vec<(usize, f64)>,
    points: &'a [FacingPoint],
    beside: Beside,
    n_references: usize,
}

/// What one field says of them.
struct Drawn {
    regions: Vec<Option<RegionValues>>,
    /// At each place of the joint.
    jumps: Vec<Option<Jump>>,
}

/// What frames have in common, made of one of them: where others have measured other nodes they make it anew.
struct Kept {
    measured: Vec<bool>,
    noise: NodalNoise,
    growth: Point,
    arms: Arc<Option<Arms>>,
}

/// What one frame says: also with the camera off by each of its uncertainties, and by which angle each section turns.
struct OfFrame {
    instant: Instant,
    by_camera: Vec<(&'static str, Instant)>,
    turns: Vec<Option<Value>>,
}

/// What a run, or a table, says.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// The instants.
    pub(super) instants: Vec<Instant>,
    /// The same with the camera off by each of its uncertainties.
    pub(super) by_camera: Vec<(&'static str, Vec<Instant>)>,
    /// Relative standard uncertainty of the size of a pixel.
    pub(super) length_scale_std: f64,
    pub(super) remarks: Vec<Remark>,
}

pub(super) fn of_run(case: &CaseFile, asked: &CaseReduction, specimen: &Specimen, run: &Path) -> Result<Found> {
    let opened = open(case, asked, specimen, run)?;
    let Opened { store, camera, is_bound, .. } = &opened;
    let reader = reader(asked, specimen, &opened)?;
    let moduli = specimen.young_mpa.zip(specimen.shear_mpa).map(|(young, shear)| [young.value, shear]);
    let moduli = moduli.filter(|_| specimen.arm_mm.is_some());
    let has_field = |frame: usize| -> Result<bool> {
        Ok(opened.load(frame).is_some() && store.status(frame)?.is_some_and(|status| status.has_field()))
    };
    let mut frames = Vec::new();
    for frame in 1..=store.n_frames() {
        frames.extend(has_field(frame)?.then_some(frame));
    }
    let load = |frame: &usize| opened.load(*frame).unwrap_or(0.0);
    let Some(largest) = frames.iter().copied().max_by(|a, b| load(a).total_cmp(&load(b))) else {
        return Err(wrong("no frame has both a field and a load"));
    };
    // What frames have in common is made of that in which the specimen is bent most.
    let read = |frame: usize, kept: Option<&Kept>| -> Result<(Kept, OfFrame)> {
        let none = || format!("frame {frame} of the run has no field");
        let of_frame = store.frame(frame)?.ok_or_else(none)?;
        let plane = camera.rectify(&of_frame.measurement);
        let of_others = kept.map(|kept| kept.noise.clone());
        let noise = NodalNoise::along(of_others, &*plane, *is_bound, Some(camera.raw_mesh()));
        let values = noise.values_only();
        let drawn = reader.draw(&plane, &noise, &values);
        let growth = kept.map(|kept| kept.growth);
        let growth = growth.or_else(|| reader.growth(&drawn)).unwrap_or_else(|| reader.growth_by_opening(&drawn));
        let same = kept.filter(|kept| kept.measured == plane.measured).map(|kept| kept.arms.clone());
        let loads = || reader.turns(&drawn, growth).into_iter().flatten().map(|(at, _)| at);
        let made = || Arc::new(moduli.and_then(|moduli| reader.beside.arms(&plane, &noise, growth, loads(), moduli)));
        let arms = same.unwrap_or_else(made);
        let at_rest = Instant::of_load(frame, Value { value: load(&frame), sigma: asked.force_std_n.unwrap_or(0.0) });
        let of_arms = (*arms).as_ref();
        let turns = reader.turns(&drawn, growth).into_iter().map(|turn| Some(turn?.1)).collect();
        let instant = reader.read(&plane, &noise, (&drawn, growth, of_arms), at_rest);
        let mut other = (*plane).clone();
        let moved = |CameraTerm { name, change, .. }: CameraTerm| {
            let changed = plane.displacement.iter().zip(change).map(|(u, by)| [u[0] + by[0], u[1] + by[1]]);
            other.displacement = changed.collect();
            let drawn = reader.draw(&other, &values, &values);
            (name, reader.read(&other, &values, (&drawn, growth, of_arms), at_rest))
        };
        let by_camera = camera.terms(&plane).into_iter().map(moved).collect();
        let kept = Kept { measured: plane.measured.clone(), noise, growth, arms };
        Ok((kept, OfFrame { instant, by_camera, turns }))
    };
    let kept = read(largest, None)?.0;
    let all = frames.par_iter().map(|&frame| Ok(read(frame, Some(&kept))?.1)).collect::<Result<Vec<OfFrame>>>()?;
    let mut found = Found { length_scale_std: store.header().pixel_size_std(), ..Found::default() };
    let mut turns: Vec<(f64, Vec<Option<Value>>)> = Vec::new();
    for of_frame in all {
        found.instants.push(of_frame.instant);
        turns.push((of_frame.instant.load_n.value, of_frame.turns));
        for (k, (name, instant)) in of_frame.by_camera.into_iter().enumerate() {
            if k == found.by_camera.len() {
                found.by_camera.push((name, Vec::new()));
            }
            found.by_camera.get_mut(k).into_iter().for_each(|(_, list)| list.push(instant));
        }
    }
    // Sections move with the load: where they do not, the upper arm is the lower one, or the test lies upside down.
    let largest = found.instants.iter().max_by(|a, b| a.load_n.value.total_cmp(&b.load_n.value));
    let is_turned = largest.and_then(|instant| instant.displacement_mm).is_some_and(|u| u.value < 0.0);
    let loads_n: Vec<(usize, f64)> =
        found.instants.iter().map(|instant| (instant.frame, instant.load_n.value)).collect();
    let machine = of_machine(asked, &opened.loads, &loads_n)?;
    for list in std::iter::once(&mut found.instants).chain(found.by_camera.iter_mut().map(|(_, list)| list)) {
        if is_turned {
            list.iter_mut().for_each(|instant| turn(instant, specimen.layout));
        }
        for (instant, u) in list.iter_mut().zip(machine.iter().flatten()) {
            (instant.displacement_mm, instant.displacement_of_images) = (u.map(exact), false);
        }
    }
    found.remarks.clone_from(&opened.loads.remarks);
    found.remarks.extend(unseen(&asked.sections, &turns));
    found.remarks.extend(uneven(specimen.layout, &turns));
    Ok(found)
}

/// Where the sections, the tip and the places of the joint are in the plane of the specimen.
fn reader<'a>(asked: &CaseReduction, specimen: &Specimen, opened: &'a Opened) -> Result<Asked<'a>> {
    let Opened { store, camera, size, zones, .. } = opened;
    let (points, header) = (opened.facing.points(), store.header());
    let tip = match asked.tip {
        Some([x, y]) => camera.camera().plane([x, y]).ok_or_else(|| wrong("tip lies where the camera folds"))?,
        None => return Err(wrong("tip = [x, y] is missing: the initial tip in the reference image, px")),
    };
    let at_tip = places_at(points, tip, header.element_size_px)?;
    let Some(point) = at_tip.first().and_then(|(k, _)| points.get(*k)) else {
        return Err(wrong("an [[opening]] between the arms is needed"));
    };
    let beside = Beside {
        tip,
        origin: point.at,
        normal: point.normal,
        tangent: point.tangent(),
        gap: point.gap,
        adhesive: asked.adhesive_mm.map(|mm| mm / size.mm_per_px()),
        arm: specimen.arm_mm.map_or(2.0 * PATCH_ELEMENTS * header.element_size_px, |arm| arm.value / size.mm_per_px()),
        zones: *zones,
        mm_per_px: size.mm_per_px(),
    };
    let (half_span, lever) = (specimen.half_span_mm.unwrap_or(1.0), specimen.lever_mm.unwrap_or(0.0));
    let all = sections(specimen.layout, half_span, lever);
    Ok(Asked {
        gauges: &opened.gauges,
        layout: specimen.layout,
        crack: asked.crack_opening_mm.zip(specimen.crack_mm).map(|(least, initial)| [least, initial.value]),
        sections: if asked.sections.is_empty() { Vec::new() } else { all },
        at_tip,
        points,
        beside,
        n_references: header.reference.len(),
    })
}

/// Sections that no frame has measured.
fn unseen(names: &[String], turns: &[(f64, Vec<Option<Value>>)]) -> Option<Remark> {
    let is_seen = |k: usize| turns.iter().any(|(_, list)| list.get(k).is_some_and(Option::is_some));
    let lost: Vec<&str> =
        names.iter().enumerate().filter(|(k, _)| !is_seen(*k)).map(|(_, name)| name.as_str()).collect();
    let text = format!(
        "no frame has measured the section {}: is it over a zone that is in view? J by loads and rotations and the displacement \
         of the load need it",
        lost.join(", ")
    );
    (!lost.is_empty()).then(|| Remark::new(Code::ReductionUnseen, About::Run, text))
}

/// Arms of a double cantilever beam that turn by different angles at the largest load.
fn uneven(layout: Layout, turns: &[(f64, Vec<Option<Value>>)]) -> Option<Remark> {
    let (_, largest) = turns.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let [Some(upper), Some(lower)] = largest[..] else { return None };
    let (off, sum) = ((upper.value - lower.value).abs(), (upper.value + lower.value).abs());
    let differ = layout == Layout::Dcb && off > UNEVEN * sum && off > 3.0 * upper.sigma.hypot(lower.sigma);
    let text = format!(
        "the upper arm turns by {:.3} degrees at the largest load, the lower by {:.3}: the arms are not alike, or the specimen turns as a \
         whole; beam methods take them alike, J does not",
        upper.value.to_degrees(),
        lower.value.to_degrees()
    );
    differ.then(|| Remark::new(Code::ReductionUneven, About::Run, text))
}

/// Turns the normal of the joint the other way. Opening does not depend on it, unless the arms are exchanged.
fn turn(instant: &mut Instant, layout: Layout) {
    let turned = |of: Value| Value { value: -of.value, ..of };
    instant.displacement_mm = instant.displacement_mm.map(turned);
    instant.rotation = instant.rotation.map(turned);
    instant.rotation_ahead = instant.rotation_ahead.map(turned);
    if Mode::of(layout) == Mode::Opening {
        instant.opening_mm = instant.opening_mm.map(turned);
    }
}

/// The two places of the joint beside the tip, with weights that lie between them.
fn places_at(points: &[FacingPoint], tip: Point, element_px: f64) -> Result<Vec<(usize, f64)>> {
    let distance = |point: &FacingPoint| (point.at[0] - tip[0]).hypot(point.at[1] - tip[1]);
    let nearest = points.iter().enumerate().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
    let Some((k, point)) = nearest.filter(|(_, point)| distance(point) <= 2.0 * element_px + point.gap) else {
        let off = nearest.map_or(f64::INFINITY, |(_, point)| distance(point));
        return Err(format!(
            "[reduction] tip = [{:.1}, {:.1}] lies {off:.0} px from the faces of the opening",
            tip[0], tip[1]
        )
        .into());
    };
    let [tx, ty] = point.tangent();
    let ahead = (tip[0] - point.at[0]) * tx + (tip[1] - point.at[1]) * ty;
    let beside = if ahead >= 0.0 { k.checked_add(1) } else { k.checked_sub(1) };
    let other = beside.and_then(|at| Some((at, points.get(at)?))).filter(|(_, other)| other.part == point.part);
    let Some((at, other)) = other else { return Ok(vec![(k, 1.0)]) };
    let length = (other.along - point.along).abs();
    let share = if length > 0.0 { (ahead.abs() / length).min(1.0) } else { 0.0 };
    Ok(vec![(k, 1.0 - share), (at, share)])
}

impl Asked<'_> {
    /// Unit vector along the joint from the first load towards the tip; `None` where no section is measured.
    fn growth(&self, drawn: &Drawn) -> Option<Point> {
        let first = drawn.regions.first().copied().flatten()?;
        let tangent = self.beside.tangent;
        let way = dot(minus(self.beside.tip, first.at), tangent);
        Some(if way < 0.0 { tangent.map(|c| -c) } else { tangent })
    }

    /// The same away from the side of the tip that is open further.
    fn growth_by_opening(&self, drawn: &Drawn) -> Point {
        let (tangent, mut sums) = (self.beside.tangent, [[0.0; 2]; 2]);
        for (point, jump) in self.points.iter().zip(&drawn.jumps) {
            let Some(jump) = jump else { continue };
            let ahead = dot(minus(point.at, self.beside.tip), tangent);
            let [sum, n] = if ahead < 0.0 { &mut sums[0] } else { &mut sums[1] };
            *sum += jump.opening.value.hypot(jump.sliding.value);
            *n += 1.0;
        }
        let [behind, ahead] = sums.map(|[sum, n]| if n > 0.0 { sum / n } else { 0.0 });
        if ahead > behind { tangent.map(|c| -c) } else { tangent }
    }

    /// How far each section lies ahead of the tip, and the angle by which it turns in the sense of its load, rad.
    ///
    /// A turn from x towards y moves a place that lies s ahead by s x d along d: less the further from the load.
    fn turns(&self, drawn: &Drawn, growth: Point) -> Vec<Option<(f64, Value)>> {
        let normal = self.beside.normal;
        let turn = |(section, read): (&LoadedSection, &Option<RegionValues>)| {
            let read = (*read)?;
            let turn = read.mean.rotation_deg?;
            let d = normal.map(|n| section.along * n);
            let sense = -cross(growth, d);
            let angle = Value { value: sense * turn.value.to_radians(), sigma: turn.sigma.to_radians() };
            Some((dot(minus(read.at, self.beside.tip), growth), angle))
        };
        self.sections.iter().zip(&drawn.regions).map(turn).collect()
    }

    /// Sections, and the jump at every place of the joint, without its uncertainty.
    fn draw(&self, field: &Measurement<Px>, noise: &NodalNoise, values: &NodalNoise) -> Drawn {
        let regions = self.gauges.draw(field, noise, None).regions;
        Drawn { regions, jumps: self.points.iter().map(|point| point.read(field, values)).collect() }
    }

    /// All that a field says of an instant whose load is known.
    fn read(
        &self,
        field: &Measurement<Px>,
        noise: &NodalNoise,
        (drawn, growth, arms): (&Drawn, Point, Option<&Arms>),
        instant: Instant,
    ) -> Instant {
        let mut instant = self.instant((field, noise), drawn, growth, instant);
        self.beside.to_faces(field, noise, &mut instant);
        instant.other_end_mm = self.other_end((field, noise), drawn, growth);
        instant.section = arms.map(|arms| self.beside.section(field, growth, arms));
        instant.crack_mm = self.crack.and_then(|[least, initial]| {
            let ahead = self.crack((field, noise), drawn, growth, least)?;
            Some(Value { value: initial + ahead.value, ..ahead })
        });
        instant
    }

    /// The jump at the other end of the joint of a bending test, mm: the mean over the furthest places ahead, where it is
    /// more than noise. `None` where the images end before the other support: what is last in view is not the end.
    fn other_end(&self, (field, noise): (&Measurement<Px>, &NodalNoise), drawn: &Drawn, growth: Point) -> Option<f64> {
        let ahead = |point: &FacingPoint| dot(minus(point.at, self.beside.tip), growth);
        let support = self.turns(drawn, growth).into_iter().flatten().map(|(at, _)| at).fold(0.0, f64::max);
        if Mode::of(self.layout) == Mode::Opening || support <= 0.0 {
            return None;
        }
        let mut places: Vec<(&FacingPoint, Jump)> =
            self.points.iter().zip(&drawn.jumps).filter_map(|(point, jump)| Some((point, (*jump)?))).collect();
        places.retain(|(point, _)| ahead(point) > 0.0);
        places.sort_by(|a, b| ahead(b.0).total_cmp(&ahead(a.0)));
        places.truncate(END_PLACES);
        places.first().filter(|(point, _)| ahead(point) >= support)?;
        let n = places.len() as f64;
        let [opening, sliding] = [|jump: &Jump| jump.opening.value, |jump: &Jump| jump.sliding.value]
            .map(|of| places.iter().map(|(_, jump)| of(jump)).sum::<f64>() / n);
        let one = places.first()?.0.read(field, noise)?;
        let (value, sigma) = match Mode::of(self.layout) {
            Mode::Sliding => (sliding.abs(), one.sliding.sigma),
            _ => (opening.hypot(sliding), one.opening.sigma.hypot(one.sliding.sigma)),
        };
        (value > END_SEEN * sigma / n.sqrt()).then_some(self.beside.mm_per_px * value)
    }

    /// What sections and the opening say, in mm.
    fn instant(
        &self,
        (field, noise): (&Measurement<Px>, &NodalNoise),
        drawn: &Drawn,
        growth: Point,
        instant: Instant,
    ) -> Instant {
        let mm = |of: Value| Value { value: self.beside.mm_per_px * of.value, sigma: self.beside.mm_per_px * of.sigma };
        let jump = |pick: fn(&Jump) -> Value| -> Option<Value> {
            let mut sum = Value { value: 0.0, sigma: 0.0 };
            for (k, weight) in &self.at_tip {
                let there = pick(&self.points.get(*k)?.read(field, noise)?);
                sum = Value { value: sum.value + weight * there.value, sigma: sum.sigma.hypot(weight * there.sigma) };
            }
            Some(mm(sum))
        };
        let normal = self.beside.normal;
        let of_sections: Option<Vec<(LoadedSection, RegionValues)>> =
            self.sections.iter().zip(&drawn.regions).map(|(section, read)| Some((*section, (*read)?))).collect();
        let of_sections = of_sections.filter(|list| !list.is_empty());
        let displacement = of_sections.as_ref().map(|list| {
            let of = |(section, RegionValues { mean, .. }): &(LoadedSection, RegionValues)| {
                let d = normal.map(|n| section.along * n);
                let sigma = (d[0] * mean.sigma[0]).hypot(d[1] * mean.sigma[1]);
                (section.share, Value { value: d[0] * mean.displacement[0] + d[1] * mean.displacement[1], sigma })
            };
            weighed_sum(list.iter().map(of))
        });
        let turns: Option<Vec<(f64, Value)>> = self.turns(drawn, growth).into_iter().collect();
        let turns = turns.filter(|list| !list.is_empty());
        let sines = |of: &(f64, Value), share: f64| (share, Value { value: of.1.value.sin(), ..of.1 });
        let rotation = turns
            .as_ref()
            .map(|list| weighed_sum(list.iter().zip(&self.sections).map(|(of, section)| sines(of, section.share))));
        // Of a beam whose ends alone are pulled no load lies ahead.
        let ahead = turns.as_ref().map(|list| {
            let shares = list.iter().zip(&self.sections).filter(|(of, _)| of.0 > 0.0);
            weighed_sum(shares.map(|(of, section)| sines(of, section.share)))
        });
        let rotation_ahead = ahead.or((self.layout == Layout::Dcb).then(|| exact(0.0)));
        Instant {
            displacement_mm: displacement.map(mm),
            displacement_of_images: true,
            rotation,
            rotation_ahead,
            rotation_common: rotation.map_or(0.0, |of| of.sigma / (1.0 + self.n_references as f64).sqrt()),
            opening_mm: jump(|jump| jump.opening),
            sliding_mm: jump(|jump| jump.sliding),
            ..instant
        }
    }

    /// How far beyond the tip the separation exceeds `least`, mm; `None` where the images do not show where it ends.
    fn crack(
        &self,
        (field, noise): (&Measurement<Px>, &NodalNoise),
        drawn: &Drawn,
        growth: Point,
        least: f64,
    ) -> Option<Value> {
        let place = |at: Point| self.beside.mm_per_px * dot(minus(at, self.beside.tip), growth);
        let size = |jump: &Jump| match self.layout {
            Layout::Dcb | Layout::Peel => jump.opening,
            Layout::Enf | Layout::Lap => Value { value: jump.sliding.value.abs(), ..jump.sliding },
            Layout::Mmb | Layout::Slb => Value {
                value: jump.opening.value.hypot(jump.sliding.value),
                sigma: jump.opening.sigma.max(jump.sliding.sigma),
            },
        };
        let read = self.points.iter().zip(&drawn.jumps);
        let mut along: Vec<(f64, Value, &FacingPoint)> =
            read.filter_map(|(point, jump)| Some((place(point.at), size(jump.as_ref()?), point))).collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        let least = least / self.beside.mm_per_px;
        // Closed everywhere, or not yet open to the tip.
        let at_tip = Some(exact(0.0));
        if along.iter().all(|(_, size, _)| size.value < least) {
            return at_tip;
        }
        // The furthest place that is open.
        let [here, next] =
            along.array_windows::<2>().rfind(|[here, next]| here.1.value >= least && next.1.value < least)?;
        if next.0 <= 0.0 {
            return at_tip;
        }
        let fall = here.1.value - next.1.value;
        let share = (here.1.value - least) / fall;
        let step = next.0 - here.0;
        let sigma = |at: &FacingPoint| Some(size(&at.read(field, noise)?).sigma);
        let sigma = step * sigma(here.2)?.max(sigma(next.2)?) / fall;
        Some(Value { value: (here.0 + share * step).max(0.0), sigma })
    }
}
