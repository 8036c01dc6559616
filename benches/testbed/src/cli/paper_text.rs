//! The tables of the paper as people read them.

use super::args::PaperArgs;
use super::plural;
use quadrille::identify::SweepRow;
use quadrille::virtual_test::PIXEL_MM;
use quadrille_testbed::paper::{
    BULK, LevelFits, LevelSummary, PUBLISHED_STIFFNESS, REFERENCE_LAW, SWEEP_NOISE_PX, SweepSummary, TABLE_1, TABLE_2,
    Trends, summary, sweep_summary, trends_of_means,
};
use std::fmt::Write as _;

/// What `tables.md` of `testbed paper` says.
pub(super) fn markdown(
    args: &PaperArgs,
    table_1: &[(u64, LevelFits)],
    clean: &[(u64, Vec<SweepRow>)],
    noisy: &[(u64, Vec<SweepRow>)],
    (frames, rms): (usize, f64),
) -> String {
    let mut text = String::new();
    let version = env!("CARGO_PKG_VERSION");
    // Writing into a `String` cannot fail, here and below.
    let _ = writeln!(
        text,
        "# Fedele, Raka, Hild and Roux (2009) done again\n\nquadrille {version}, {} from seed {}.",
        plural(args.seeds, "draw"),
        args.seed
    );
    let _ = writeln!(text, "Mean and standard deviation over the draws; one pixel is {:.3} um.\n", 1e3 * PIXEL_MM);
    first_table(&mut text, table_1);
    let rows = second_table(&mut text, clean, noisy);
    stiffness(&mut text, &rows);
    let _ = writeln!(
        text,
        "\n## Images\n\n{frames} frames of the virtual test correlated; measured less true displacement: {rms:.3} px rms."
    );
    text
}

/// Table 1: fits at several levels of noise.
fn first_table(text: &mut String, table_1: &[(u64, LevelFits)]) {
    let _ = writeln!(
        text,
        "## Table 1\n\n| r | s (px) | | phi_n (N/mm) | delta_n (um) | delta_t (um) | omega | inside bounds | evaluations, most |\n|---|---|---|---|---|---|---|---|---|"
    );
    for (r, level) in table_1 {
        let LevelSummary { n, inside, mean, spread, evaluations } = summary(level);
        let s = level.s_px;
        let entry = |k: usize, scale: f64| match n {
            1 => format!("{:.4}", scale * mean[k]),
            _ => format!("{:.3} +- {:.3}", scale * mean[k], scale * spread[k]),
        };
        let omega = if s > 0.0 { entry(3, 1.0) } else { format!("{:.1e}", mean[3]) };
        let _ = writeln!(
            text,
            "| {r} | {s} | quadrille | {} | {} | {} | {omega} | {inside} of {n} | {evaluations} |",
            entry(0, 1.0),
            entry(1, 1e3),
            entry(2, 1e3)
        );
        if s == 0.0 {
            let error = (0..3).map(|k| (mean[k] / REFERENCE_LAW[k] - 1.0).abs()).fold(0.0, f64::max);
            let _ = writeln!(text, "| {r} | {s} | largest relative error | {error:.1e} | | | | | |");
        }
        if let Some(p) = TABLE_1.iter().find(|p| p.key == s && *r == 6) {
            let omega = p.omega.map(|omega| omega.to_string()).unwrap_or_default();
            let _ = writeln!(
                text,
                "| {r} | {s} | paper, one draw | {} | {} | {} | {omega} | | |",
                p.phi_n, p.delta_n, p.delta_t
            );
        }
    }
}

/// Table 2: fits with r prescribed, and their means.
fn second_table(
    text: &mut String,
    clean: &[(u64, Vec<SweepRow>)],
    noisy: &[(u64, Vec<SweepRow>)],
) -> Vec<SweepSummary> {
    let (rows, trends) = sweep_summary(noisy);
    let (clean_rows, clean_trends) = sweep_summary(clean);
    let _ = writeln!(
        text,
        "\n## Table 2\n\nTruth: the parameters of the experiment, r = 4; noise of {SWEEP_NOISE_PX} px.\n\n| r | | phi_n (N/mm) | phi_t (N/mm) | delta_n (um) | delta_t (um) | K_n (GPa/mm) | K_t (GPa/mm) | omega |\n|---|---|---|---|---|---|---|---|---|"
    );
    for (SweepSummary { r, mean, spread }, clean) in rows.iter().zip(&clean_rows) {
        let scales = [1.0, 1.0, 1e3, 1e3, 1e-3, 1e-3, 1.0];
        let entry = |k: usize| format!("{:.3} +- {:.3}", scales[k] * mean[k], scales[k] * spread[k]);
        let cells: Vec<String> = (0..7).map(entry).collect();
        let _ = writeln!(text, "| {r} | quadrille | {} |", cells.join(" | "));
        let cells: Vec<String> = (0..6).map(|k| format!("{:.3}", scales[k] * clean.mean[k])).collect();
        let _ = writeln!(text, "| {r} | without noise | {} | {:.1e} |", cells.join(" | "), clean.mean[6]);
        if let Some(p) = TABLE_2.iter().find(|p| p.key == *r) {
            let (kn, kt) = (p.phi_n / p.delta_n.powi(2) * 1e3, 2.0 * r * p.phi_n / p.delta_t.powi(2) * 1e3);
            let _ = writeln!(
                text,
                "| {r} | paper | {} | {:.1} | {} | {} | {kn:.1} | {kt:.2} | 7.5 |",
                p.phi_n,
                r * p.phi_n,
                p.delta_n,
                p.delta_t
            );
        }
    }
    let most = |pick: fn(&Trends) -> f64| trends.iter().map(pick).fold(0.0, f64::max);
    let monotonic = trends.iter().filter(|t| t.monotonic).count();
    let _ = writeln!(
        text,
        "\nOver r = 3 to 6, the largest of the draws: phi_n and delta_n fall and delta_t and phi_t rise in {monotonic} of {}; the initial normal stiffness changes by {:.2e} of itself, the tangential one by {:.2e}, omega by {:.2e}.",
        trends.len(),
        most(|t| t.normal_stiffness),
        most(|t| t.tangential_stiffness),
        most(|t| t.omega)
    );
    for (what, t) in std::iter::once(("In the mean of the draws", trends_of_means(&rows)))
        .chain(clean_trends.first().map(|t| ("Without noise", *t)))
    {
        let _ = writeln!(
            text,
            "{what}: the normal stiffness changes by {:.2e}, the tangential one by {:.2e}.",
            t.normal_stiffness, t.tangential_stiffness
        );
    }
    rows
}

/// The initial stiffnesses beside those of the bulk.
fn stiffness(text: &mut String, rows: &[SweepSummary]) {
    let [e, nu, thickness] = BULK;
    let bulk = [e * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu) * thickness), e / (2.0 * (1.0 + nu)) / thickness];
    let _ = writeln!(
        text,
        "\n## Initial stiffness (GPa/mm)\n\n| | identified, r = 4 | paper, experiment | bulk epoxy, E = {e} MPa, nu = {nu} |\n|---|---|---|---|"
    );
    if let Some(row) = rows.iter().find(|row| row.r == 4.0) {
        for (k, name) in ["normal: E(1-nu)/[(1+nu)(1-2nu)t]", "tangential: G/t"].into_iter().enumerate() {
            let _ = writeln!(
                text,
                "| {name} | {:.2} +- {:.2} | {:.1} | {:.1} |",
                1e-3 * row.mean[4 + k],
                1e-3 * row.spread[4 + k],
                1e-3 * PUBLISHED_STIFFNESS[k],
                1e-3 * bulk[k]
            );
        }
    }
}
