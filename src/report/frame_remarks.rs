//! What there is to say of a frame and of its image.

use crate::correlate::{Ambiguity, Correlation, ZoneResult};
use crate::field::{NOISE_CONTRADICTED, Status};
use crate::imaging::{Blank, Saturation};
use crate::remark::{About, Code, Remark};

/// Share of saturated pixels above which it is said, per cent.
const SATURATED_PERCENT: f64 = 1.0;

/// All that the result of frame `number` says by itself.
pub fn of_result(number: usize, result: &Correlation) -> impl Iterator<Item = Remark> {
    let has_field = result.measurement.status.has_field();
    let of_zones =
        result.zones.iter().filter_map(noise_contradicted).chain(result.zones.iter().filter_map(light_unsettled));
    let of_frame =
        noise_bound(number, result.nodes_at_bound).into_iter().chain(result.ambiguity.iter().map(texture_repeats));
    let of_frame = of_frame.chain(zones_lost(number, result));
    of_zones.chain(of_frame).filter(move |_| has_field)
}

/// Frame `number` has no field, because of `why`.
pub(super) fn unreadable(number: usize, why: String) -> Remark {
    Remark::new(Code::FrameUnreadable, About::Frames(vec![number]), why)
}

/// Saturated pixels of the image that is spoken of; `None` when they are few.
pub fn saturated(about: About, found: Saturation) -> Option<Remark> {
    (found.percent() > SATURATED_PERCENT).then(|| {
        let share = |n: usize| 100.0 * n as f64 / found.n as f64;
        let (percent, black, white) = (found.percent(), share(found.black), share(found.white));
        let text = format!(
            "{percent:.1} % of the pixels in the zones are saturated ({black:.1} % at 0, {white:.1} % at {}): they \
             show no texture; change the exposure, or leave such places out of the zones",
            found.depth.highest()
        );
        let remark = Remark::new(Code::ImageSaturated, about, text);
        remark.with("saturated_percent", percent).with("black_percent", black).with("white_percent", white)
    })
}

/// The image of frame `number` is not whole.
pub(super) fn incomplete(number: usize, blank: Blank) -> Remark {
    let (what, first, last) = match blank {
        Blank::Rows(first, last) => ("rows", first, last),
        Blank::Columns(first, last) => ("columns", first, last),
    };
    let remark = Remark::new(Code::ImageIncomplete, About::Frames(vec![number]), blank.to_string());
    remark.with("of", what).with("first_px", first).with("last_px", last)
}

/// A stated noise that the residual of a zone contradicts; `None` where it does not.
fn noise_contradicted(zone: &ZoneResult) -> Option<Remark> {
    let ratio = zone.residual_noise / zone.noise;
    let [least, most] = NOISE_CONTRADICTED;
    if !(ratio.is_finite() && (ratio < least || ratio > most)) {
        return None;
    }
    let what = match ratio < least {
        true => "less than it can be with that noise: standard uncertainties are too large",
        false => {
            "more than that noise explains: the noise is larger, or the displacement is not followed, and standard \
                  uncertainties are too small"
        }
    };
    let text = format!(
        "zone {}: the noise is stated as {:.3} grey levels, and the residual says {:.3} ({ratio:.2} times), {what}",
        zone.name, zone.noise, zone.residual_noise
    );
    let remark = Remark::new(Code::NoiseContradicted, About::Zone(zone.name.clone()), text);
    Some(remark.with("stated_grey", zone.noise).with("residual_grey", zone.residual_noise).with("ratio", ratio))
}

/// Light that stayed as it was because it did not settle; `None` where it did.
fn light_unsettled(zone: &ZoneResult) -> Option<Remark> {
    zone.light.filter(|light| light.unsettled).map(|_| {
        let text = format!(
            "zone {}: brightness and contrast change over it, and did not come to rest with the displacement; they \
             stayed as they were found, and standard uncertainties do not know of that: light the specimen more \
             evenly, or leave out of the zone where it changes",
            zone.name
        );
        Remark::new(Code::LightUnsettled, About::Zone(zone.name.clone()), text)
    })
}

/// Nodes whose standard uncertainty is a lower bound; `None` where there are none.
fn noise_bound(number: usize, n_nodes: usize) -> Option<Remark> {
    (n_nodes > 0).then(|| {
        let text = format!(
            "around {n_nodes} nodes the gradient of the reference holds little beside noise: their standard \
             uncertainty is a lower bound; enlarge the elements, or average several images of the reference"
        );
        Remark::new(Code::NoiseBound, About::Frames(vec![number]), text).with("nodes", n_nodes)
    })
}

/// The zones of frame `number` that were not found while others were; `None` where all were.
fn zones_lost(number: usize, result: &Correlation) -> Option<Remark> {
    let lost = result.zones.iter().filter(|zone| zone.status != Status::Converged);
    let lost: Vec<String> = lost
        .map(|zone| match zone.status {
            Status::LeftImage => format!("zone {} has left the image", zone.name),
            _ => format!("zone {} was not found: it does not match anywhere", zone.name),
        })
        .collect();
    let text = format!("{}; the rest is measured without it", lost.join(", "));
    let is_said = result.measurement.status == Status::PartlyLost && !lost.is_empty();
    is_said.then(|| Remark::new(Code::ZoneLost, About::Frames(vec![number]), text).with("zones", lost.len()))
}

fn texture_repeats(ambiguity: &Ambiguity) -> Remark {
    Remark::new(Code::TextureRepeats, About::Zone(ambiguity.zone.clone()), ambiguity.to_string())
        .with("period_px", ambiguity.period_px)
        .with("from_expected_px", ambiguity.from_expected_px)
        .with("confirmed", if ambiguity.confirmed { "yes" } else { "no" })
}
