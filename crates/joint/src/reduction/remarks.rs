//! What is to be looked at in a reduced test.

use super::compliance::StraightLine;
use super::methods::MethodResult;
use super::specimen::{Instant, Mode, Specimen};
use super::traction::TractionCurve;
use crate::remark::{About, Code, Remark};

/// Slack by the displacement at the end of the straight begin that is worth a word.
const SLACK: f64 = 0.05;
/// Difference of two methods, relative, that is worth a word when both uncertainties do not explain it: a fracture zone
/// as long as an arm costs beam theory some 7 %.
const DIFFERENT: f64 = 0.15;
/// By what a stated modulus may be off the one that the initial compliance asks for: a soft adhesive costs a third.
const MODULUS: f64 = 3.0;
/// Moduli of arms, MPa: wood across the grain to carbon fibres along them.
const YOUNG: [f64; 2] = [100.0, 5e5];

/// A load that falls by this share at once, while the joint opens by no more than in the steps before: a jump of the
/// crack. Growth in a stable test takes a tenth of the load off in several instants.
const FALL: f64 = 0.1;

fn numbers(instants: &[Instant], which: impl Fn(usize) -> bool) -> Vec<usize> {
    instants.iter().enumerate().filter(|(k, _)| which(*k)).map(|(_, instant)| instant.frame).collect()
}

fn list(numbers: &[usize]) -> String {
    let few: Vec<String> = numbers.iter().take(8).map(usize::to_string).collect();
    format!("{}{}", few.join(", "), if numbers.len() > 8 { ", ..." } else { "" })
}

pub(super) fn slack(line: Option<&StraightLine>, instants: &[Instant]) -> Option<Remark> {
    let remark = |text: String| Remark::new(Code::ReductionSlack, About::Run, text);
    let Some(line) = line else {
        let is_known = instants.iter().any(|instant| instant.displacement_mm.is_some());
        let text = "fewer than three instants lie on the straight begin (10 to 50 % of the largest load): displacements are taken as \
                    they are, slack included";
        return is_known.then(|| remark(text.to_owned()));
    };
    let end = instants.get(line.instants[1])?.displacement_mm?.value;
    let share = line.slack_mm / end;
    let text = format!(
        "the curve begins {:+.4} mm from the origin, {:.0} % of the displacement at the end of its straight part: slack is taken off",
        line.slack_mm,
        100.0 * share
    );
    (share.abs() > SLACK).then(|| remark(text).with("slack_mm", line.slack_mm))
}

pub(super) fn unloading(instants: &[Instant], grows: &[bool]) -> Option<Remark> {
    let back = numbers(instants, |k| !grows[k]);
    let text = format!(
        "the joint closes at instants {}: they are left out of the traction and of mean values, which hold while it opens",
        list(&back)
    );
    (!back.is_empty()).then(|| Remark::new(Code::ReductionUnloading, About::Instants(back), text))
}

/// J falls while the joint opens: no law of the separation alone does that.
pub(super) fn falls(instants: &[Instant], result: &MethodResult, grows: &[bool], mode: Mode) -> Option<Remark> {
    let mut most: Option<(f64, f64, f64)> = None;
    let mut fallen = Vec::new();
    for (k, instant) in instants.iter().enumerate().filter(|(k, _)| grows[*k]) {
        let (Some(release), Some(jump)) = (result.release[k], instant.jump(mode)) else { continue };
        if let Some((highest, sigma, at)) = most {
            let noise = 4.0 * release.sigma.hypot(sigma);
            if jump.value > at + 3.0 * jump.sigma && release.value < highest - noise.max(0.02 * highest) {
                fallen.push(instant.frame);
            }
        }
        if most.is_none_or(|(highest, ..)| release.value > highest) {
            most = Some((release.value, release.sigma, jump.value));
        }
    }
    let text = format!(
        "J falls while the joint opens (instants {}): the traction would be negative; the crack front may not be straight, or loads act \
         elsewhere than said",
        list(&fallen)
    );
    (!fallen.is_empty()).then(|| Remark::new(Code::ReductionFalls, About::Instants(fallen), text))
}

/// The initial compliance asks for a modulus that the arms cannot have: a length, a load or a modulus has another unit.
pub(super) fn implausible(result: &MethodResult, specimen: &Specimen) -> Option<Remark> {
    let found = result.young_of_compliance?.value;
    let text = match specimen.young_mpa.map(|young| young.value) {
        Some(stated) if !(1.0 / MODULUS..MODULUS).contains(&(found / stated)) => format!("E_MPa = {stated}, but "),
        None if !(YOUNG[0]..YOUNG[1]).contains(&found) => String::new(),
        _ => return None,
    };
    let text = format!(
        "{text}the initial compliance asks for a modulus of {found:.3e} MPa with this width, arm and crack: is one of them, or the load, \
         in another unit?"
    );
    Some(Remark::new(Code::MaterialImplausible, About::Parameter("E_MPa".into()), text).with("value_MPa", found))
}

/// Two methods that differ by more than their uncertainties.
pub(super) fn disagree(methods: &[MethodResult]) -> Option<Remark> {
    let known: Vec<_> = methods.iter().filter_map(|result| Some((result, result.growth?))).collect();
    let differ = |a: &(&MethodResult, crate::field::Value), b: &(&MethodResult, crate::field::Value)| {
        let off = (a.1.value - b.1.value).abs();
        off > DIFFERENT * a.1.value.abs() && off > 3.0 * a.1.sigma.hypot(b.1.sigma)
    };
    let first = known.first()?;
    let others: Vec<String> = (known.iter().skip(1).filter(|other| differ(first, other)))
        .map(|(result, value)| format!("{} {:.4}", result.method.name(), value.value))
        .collect();
    let text = format!(
        "methods differ after growth has begun by more than noise: {} {:.4} N/mm, {}; beam theory leaves out a fracture zone that is \
         long against the arm, and takes E, arm and crack as stated",
        first.0.method.name(),
        first.1.value,
        others.join(", ")
    );
    (!others.is_empty()).then(|| Remark::new(Code::ReductionDisagree, About::Run, text))
}

/// The load falls at once: growth was not stable there.
pub(super) fn jumps(instants: &[Instant], grows: &[bool]) -> Option<Remark> {
    let steps: Vec<f64> = (instants.array_windows::<2>())
        .filter_map(|[a, b]| Some((b.displacement_mm?.value - a.displacement_mm?.value).abs()))
        .collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = *sorted.get(sorted.len() / 2)?;
    let is_jump = |k: &usize| {
        let [before, after] = [k - 1, *k].map(|k| instants[k]);
        let step = before.displacement_mm.zip(after.displacement_mm).map(|(a, b)| b.value - a.value);
        let noise = 4.0 * before.load_n.sigma.hypot(after.load_n.sigma);
        let fall = before.load_n.value - after.load_n.value;
        grows[*k] && step.is_some_and(|step| step < 2.0 * usual) && fall > (FALL * before.load_n.value).max(noise)
    };
    let at: Vec<usize> = (1..instants.len()).filter(is_jump).map(|k| instants[k].frame).collect();
    let text = format!(
        "the load falls at once at instants {}: the crack jumped, and what is printed there is of its arrest",
        list(&at)
    );
    (!at.is_empty()).then(|| Remark::new(Code::ReductionJump, About::Instants(at), text))
}

/// A peak of the traction that noise of the separations has smeared.
pub(super) fn smeared(curve: &TractionCurve) -> Option<Remark> {
    let text = format!(
        "the peak of the traction is not told: separations are uncertain by {:.1e} mm, and a slope over them tells one that lies at \
         three times as much or more; a camera that sees the tip larger tells it",
        curve.separation_std_mm
    );
    let remark = || Remark::new(Code::ReductionSmeared, About::Run, text);
    curve.peak.is_none().then(remark).map(|remark| remark.with("separation_std_mm", curve.separation_std_mm))
}
