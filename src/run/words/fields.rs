//! What a whole series says of its fields: nodes lost in noise, light, strains.

use crate::field::Flattened;
use crate::remark::{About, Code, Remark};
use crate::report::summary::{FrameSummary, Summary};
use crate::run::words::remarks::name_frames;

/// Frames with nodes that the reference seemed to show and that are lost in the noise.
pub(crate) fn in_noise(summary: &Summary) -> Option<Remark> {
    let lost = || summary.frames.iter().filter(|frame| frame.status.has_field() && frame.nodes_in_noise > 0);
    let numbers: Vec<usize> = lost().map(|frame| frame.number).collect();
    let most = lost().map(|frame| frame.nodes_in_noise).max()?;
    let place = name_frames(&numbers);
    let text = format!(
        "{place}: up to {most} nodes not measured: the texture there does not stand out of the noise that the residual \
         shows (nodes_in_noise)"
    );
    Some(Remark::new(Code::NodesInNoise, About::Frames(numbers), text).with("nodes", most))
}

/// Frames in which fields of light did not come to rest with the displacement.
pub(crate) fn in_unsettled_light(frames: &[FrameSummary]) -> Option<Remark> {
    let is_unsettled =
        |frame: &&FrameSummary| frame.zones.iter().any(|zone| zone.light.is_some_and(|light| light.unsettled));
    let numbers: Vec<usize> = frames.iter().filter(is_unsettled).map(|frame| frame.number).collect();
    let text = format!(
        "{}: brightness and contrast did not come to rest with the displacement, and standard uncertainties do not know of \
         that (see their messages)",
        name_frames(&numbers)
    );
    (!numbers.is_empty()).then(|| Remark::new(Code::LightUnsettled, About::Frames(numbers), text))
}

/// Frames in which many windows of nodes flatten the strain, with the worst of them.
pub(crate) fn flattened(frames: &[FrameSummary]) -> Option<Remark> {
    let much = |frame: &FrameSummary| Some((frame.number, frame.flattened.filter(Flattened::is_much)?));
    let found: Vec<(usize, Flattened)> = frames.iter().filter_map(much).collect();
    let (number, worst) = found.iter().max_by(|(_, a), (_, b)| a.model_error.total_cmp(&b.model_error))?;
    let numbers: Vec<usize> = found.iter().map(|(number, _)| *number).collect();
    let text =
        format!("{}: strains over windows are flattened, most in frame {number}: {worst}", name_frames(&numbers));
    let Flattened { percent, at: [x, y], model_error, sigma, would_do, .. } = *worst;
    let remark = Remark::new(Code::StrainFlattened, About::Frames(numbers), text)
        .with("frame", *number)
        .with("windows_percent", percent)
        .with("x_px", x)
        .with("y_px", y)
        .with("model_error", model_error)
        .with("sigma", sigma);
    Some(match would_do {
        Some(window) => remark.with("would_do_nodes", window.nodes()),
        None => remark,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::StrainWindow;
    use crate::report::summary::{LightSummary, ZoneSummary};

    #[test]
    fn frames_whose_light_did_not_come_to_rest_are_named_and_no_others() {
        let frames: Vec<FrameSummary> = [None, Some(true), Some(false), Some(true)]
            .into_iter()
            .zip(1..)
            .map(|(unsettled, number)| {
                let light = unsettled.map(|unsettled| LightSummary {
                    nodes: [3, 3],
                    gain: [1.0; 2],
                    offset_grey: [0.0; 2],
                    unsettled,
                });
                let zone = ZoneSummary {
                    status: None,
                    name: "all".into(),
                    rigid_motion: None,
                    correlation: 1.0,
                    residual_grey: 1.0,
                    noise_grey: 1.0,
                    noise_residual_grey: None,
                    gain: 1.0,
                    offset_grey: 0.0,
                    light,
                };
                FrameSummary {
                    zones: vec![zone],
                    ..FrameSummary::unreadable(number, String::new(), String::new(), 0.0)
                }
            })
            .collect();
        let said = in_unsettled_light(&frames).unwrap();
        assert_eq!((said.code, said.about), (Code::LightUnsettled, About::Frames(vec![2, 4])));
        assert_eq!(in_unsettled_light(&frames[2..3]), None);
    }

    #[test]
    fn frames_whose_strains_are_flattened_are_named_with_the_worst_place_and_the_window_that_would_do() {
        let of = |percent: f64, model_error: f64| Flattened {
            windows: 3,
            percent,
            at: [40.0, 56.0],
            model_error,
            sigma: 1e-5,
            would_do: StrainWindow::new(3),
        };
        let frames: Vec<FrameSummary> = [None, Some(of(30.0, 1e-4)), Some(of(50.0, 2e-4)), Some(of(4.0, 3e-4))]
            .into_iter()
            .zip(1..)
            .map(|(flattened, number)| FrameSummary {
                flattened,
                ..FrameSummary::unreadable(number, String::new(), String::new(), 0.0)
            })
            .collect();
        let said = flattened(&frames).unwrap();
        assert_eq!((said.code, &said.about), (Code::StrainFlattened, &About::Frames(vec![2, 3])));
        let values = ["frame", "windows_percent", "x_px", "y_px", "would_do_nodes"].map(|name| said.number(name));
        assert_eq!(values, [3.0, 50.0, 40.0, 56.0, 3.0].map(Some));
        assert_eq!(flattened(&frames[3..]), None);
    }
}
