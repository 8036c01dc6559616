//! A device that computes something else than the CPU is found before it measures.

#![cfg(feature = "gpu")]

use crate::common;
use common::gpu::{device, device_with};
use common::{eight_bit, inside, picture, prepared_on};
use quadrille::backend::BackendError;
use quadrille::backend::check::DeviceCheck;
use quadrille::backend::gpu::{GpuOptions, KERNELS, Kernel, source};
use quadrille::correlate::Options;
use quadrille::imaging::Interpolation;
use quadrille::synth::{RenderOptions, Translation};

/// What may be wrong with a driver, a compiler or a card, in every kernel that decides where an iteration ends: what is
/// altered, and into what.
const ALTERED: [[&str; 3]; 18] = [
    ["pixels a little too bright", "= value - unpack.offset", "= 1.004 * value - unpack.offset"],
    ["means of four a little too large", "0.25 * ((fine", "0.2505 * ((fine"],
    ["gain of the prefilter", "prefilter.own * s + dot", "prefilter.own * s + 1.01 * dot"],
    ["border of the plane", "2.0 * plane[place(0, y)] - plane[place(inner, y)]", "plane[place(0, y)]"],
    ["gradient along y", "dot(gradient.derivative[0], even)", "1.01 * dot(gradient.derivative[0], even)"],
    ["sign of a gradient", "f32(bitcast<i32>(word << 16u) >> 16u)", "f32(word & 0xffffu)"],
    ["a moment of the matrix", "xy_far += (fx * fy * far) * wx", "xy_far += (fx * fx * far) * wx"],
    ["place of sampling, 0.02 px", "let tx = ux - f32(floor_x);", "let tx = ux - f32(floor_x) + 0.02;"],
    ["weights of the interpolation", "s2 * s * (1.0 / 6.0)", "s2 * s * (1.0 / 6.1)"],
    ["a lane of the sums", "for (var i = 0u; i < LANES; i++)", "for (var i = 1u; i < LANES; i++)"],
    ["a sum of grey levels", "total[5] += sums[at + GG];", "total[5] += 0.99 * sums[at + GG];"],
    ["gain of elements", "gain = covariance / variance;", "gain = 1.01 * covariance / variance;"],
    ["an element of a node", "k < incidence[node + 1u]", "k + 1u < incidence[node + 1u]"],
    ["the penalty", "r -= vec2<f32>(block.x * v.x", "r -= 0.9 * vec2<f32>(block.x * v.x"],
    ["the correction", "let moved = u.rest + turned;", "let moved = u.rest + turned + vec2<f32>(0.0005, 0.0);"],
    [
        "workgroups of a step that follows",
        "groups[3u * k] = select(0u, largest.sizes[k].x, goes_on);",
        "groups[3u * k] = 0u;",
    ],
    ["the start of a finer level", "u = clamp(2.0 * u,", "u = clamp(2.01 * u,"],
    ["light of the nodes", "along(light.gain, xi, eta) * grey", "along(light.gain, xi, eta) * grey * 1.003"],
];

#[test]
fn a_right_device_differs_from_the_cpu_by_a_part_of_what_round_off_allows() {
    let Some(gpu) = device() else { return };
    let check = DeviceCheck::of(&gpu).unwrap();
    for compared in &check.compared {
        println!("{:9.1e} of {:.1e} {:2} {}", compared.difference, compared.allowed, compared.unit, compared.what);
    }
    assert!(check.is_right(), "{:?}", check.worst());
    // What is far from its limit is no accident of one driver.
    let worst = check.worst().unwrap();
    assert!(worst.difference < 0.5 * worst.allowed, "{worst:?}");
    assert!(check.compared.len() > 30, "{}", check.compared.len());
}

#[test]
fn a_device_that_does_not_end_its_steps_where_it_is_to_fails() {
    // It goes on whatever is lost: the host asks for a field of which steps are ahead that nobody has asked for.
    let text = ["abs(steps[at].lossy - largest.lost) < 0.5", "true"];
    assert!(source(Kernel::Largest, Interpolation::Cubic).contains(text[0]));
    let altered = Some(text.map(str::to_owned));
    let Some(gpu) = device_with(&GpuOptions { altered, ..GpuOptions::default() }) else { return };
    let options = RenderOptions { noise: 1.0, ..eight_bit(160, 160) };
    let pair = [0.0, 3.3].map(|x| picture(&Translation([x, 0.0]), &options));
    // The border leaves the image.
    let correlator = prepared_on(gpu, &pair[0], &inside(160, 160, 0), Options::default());
    let error = correlator.correlate(pair[1].clone(), None).expect_err("a field that nobody knows");
    assert!(
        error.to_string().contains("failed") || format!("{error:?}").contains("steps of it are ahead"),
        "{error:?}"
    );
}

/// By `make release-check PARTS=thorough`.
mod thorough {
    use super::*;

    #[test]
    #[ignore = "make release-check PARTS=thorough"]
    fn every_altered_shader_is_found_and_named() {
        let sources: Vec<String> = [Interpolation::Cubic, Interpolation::Quintic]
            .into_iter()
            .flat_map(|interpolation| KERNELS.map(|kernel| source(kernel, interpolation)))
            .collect();
        for [what, from, to] in ALTERED {
            assert!(sources.iter().any(|source| source.contains(from)), "{what}: no shader has '{from}'");
            let altered = Some([from.to_owned(), to.to_owned()]);
            let Some(gpu) = device_with(&GpuOptions { altered, ..GpuOptions::default() }) else { return };
            let check = DeviceCheck::of(&gpu).unwrap_or_else(|error| panic!("{what}: {error}"));
            let worst = check.worst().unwrap();
            println!("{what}: {} differ by {:.1e} of {:.1e}", worst.what, worst.difference, worst.allowed);
            let error = check.right("it".into()).expect_err(what);
            assert!(matches!(&error, BackendError::Wrong { device, .. } if device == "it"), "{error}");
            assert!(error.to_string().contains("--trust-device"), "{error}");
            // And by far: what is found here would be found on smaller images.
            assert!(worst.difference > 3.0 * worst.allowed, "{what}: {worst:?}");
        }
    }
}
