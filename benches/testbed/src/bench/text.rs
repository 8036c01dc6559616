//! The figures as tables.

use super::{Clock, DeviceRecord, Record, SizeCost, Spread, Times};
use std::fmt;

/// Milliseconds: median, and fastest to slowest in brackets.
fn ms(seconds: Spread) -> String {
    let Spread { fastest, median, slowest } = seconds.scaled(1e3);
    format!("{median:.3} ({fastest:.3}-{slowest:.3})")
}

impl fmt::Display for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "quadrille {}, {}, {} threads", self.quadrille, self.machine, self.threads)?;
        writeln!(f, "{}", self.images)?;
        for device in &self.devices {
            writeln!(f)?;
            writeln!(f, "{} [{}]", device.device, device.kind)?;
            writeln!(f, "  times by     {}", device.clock.describe())?;
            let who = if device.clock == Clock::Processor { "one core copies" } else { "it copies" };
            writeln!(f, "  memory       {who} {:.1} GB/s (read and written)", device.copy_gb_per_s)?;
            if let Some(start) = &device.start_up {
                if let Some(worst) = start.check.worst() {
                    let share = 100.0 * worst.difference / worst.allowed;
                    writeln!(
                        f,
                        "  check        as the CPU; {} differ most: {share:.0} % of what round-off allows",
                        worst.what
                    )?;
                }
                writeln!(
                    f,
                    "  way          there and back {:.3} ms, a dispatch {:.3} ms (wall); {:.1} GB/s from the host",
                    1e3 * start.round_trip_s.median,
                    1e3 * start.dispatch_s,
                    start.upload_gb_per_s
                )?;
                writeln!(
                    f,
                    "  start        opened in {:.0} ms; {} kernels compiled and run for the first time in {:.0} ms (wall)",
                    1e3 * start.open_s,
                    start.kernels.len(),
                    1e3 * start.kernels_s
                )?;
                let slow = start
                    .kernels
                    .iter()
                    .map(|k| format!("{} {:.0} + {:.0}", k.kernel, 1e3 * k.compile_s, 1e3 * k.first_run_s));
                writeln!(f, "               compile + first run, ms: {}", slow.collect::<Vec<_>>().join(", "))?;
            }
            for size in &device.sizes {
                size_table(f, device, size, self.plan.element_size_px, self.plan.runs)?;
            }
        }
        ratios(f, self)
    }
}

fn size_table(
    f: &mut fmt::Formatter<'_>,
    device: &DeviceRecord,
    cost: &SizeCost,
    element: usize,
    runs: usize,
) -> fmt::Result {
    let clock = |times: Times| match device.clock {
        Clock::Processor => times.cpu,
        Clock::Device => times.wall,
    };
    let (size, n_elements, n_nodes) = (cost.size_px, cost.n_elements, cost.n_nodes);
    writeln!(f)?;
    writeln!(
        f,
        "  {size} x {size} px, {n_elements} elements of {element} px, {n_nodes} nodes; median (fastest-slowest) of {runs}"
    )?;
    writeln!(f, "  {:28} {:>24} {:>7} {:>7} {:>7}", "pass, in and out of the host", "ms", "ns/px", "GB/s", "of copy")?;
    for pass in &cost.passes {
        writeln!(
            f,
            "  {:28} {:>24} {:7.3} {:7.2} {:5.0} %",
            pass.name,
            ms(clock(pass.seconds)),
            pass.ns_per_px,
            pass.bound.gb_per_s,
            pass.bound.percent_of_copy
        )?;
    }
    if !cost.kernels.is_empty() {
        writeln!(f, "  {:28} {:>24} {:>7} {:>7} {:>7}", "kernel (dispatches)", "ms", "ns/px", "GB/s", "of copy")?;
    }
    for kernel in &cost.kernels {
        writeln!(
            f,
            "  {:28} {:>24} {:7.3} {:7.2} {:5.0} %",
            format!("{} ({})", kernel.kernel, kernel.dispatches),
            ms(kernel.seconds),
            kernel.ns_per_px,
            kernel.bound.gb_per_s,
            kernel.bound.percent_of_copy
        )?;
    }
    let both = |times: Times| format!("{} ms wall, {:.3} ms processor", ms(times.wall), 1e3 * times.cpu.fastest);
    writeln!(f, "  cold pair: reference {}", both(cost.pair.reference_s))?;
    writeln!(f, "             frame     {}", both(cost.pair.frame_s))?;
    writeln!(f, "             {} + {} coarse iterations", cost.pair.iterations, cost.pair.coarse_iterations)?;
    writeln!(
        f,
        "  series:    {:.1} frames/s; {:.1} iterations; {} frames\n             {}",
        cost.series.frames_per_s,
        cost.series.iterations,
        cost.series.frames,
        both(cost.series.frame_s)
    )?;
    if let Some(traffic) = &cost.series.traffic {
        writeln!(
            f,
            "             per frame {} submissions, {} readbacks, {} B up, {} B down\n             host's own thread {:.3} ms",
            traffic.submissions,
            traffic.readbacks,
            traffic.bytes_up,
            traffic.bytes_down,
            1e3 * cost.series.host_s.unwrap_or_default().fastest
        )?;
    }
    if !cost.series.shares.is_empty() {
        let shares: Vec<_> = cost.series.shares.iter().map(|s| format!("{} {:.1} %", s.part, s.percent)).collect();
        writeln!(f, "             {}", shares.join(", "))?;
    }
    Ok(())
}

/// Every device against the first, where they have been measured by the same clock.
fn ratios(f: &mut fmt::Formatter<'_>, record: &Record) -> fmt::Result {
    let [first, others @ ..] = record.devices.as_slice() else { return Ok(()) };
    for device in others {
        writeln!(f)?;
        writeln!(f, "{} against {}: time per pixel, as so many times", device.device, first.device)?;
        if device.clock != first.clock {
            writeln!(f, "  (different clocks: one core's time against the device's)")?;
        }
        for (cost, other) in device.sizes.iter().zip(&first.sizes) {
            let ratios: Vec<_> = cost
                .passes
                .iter()
                .zip(&other.passes)
                .map(|(pass, other)| format!("{} {:.3}", pass.name, pass.ns_per_px / other.ns_per_px))
                .collect();
            writeln!(f, "  {:6} px: {}", cost.size_px, ratios.join(", "))?;
        }
    }
    Ok(())
}
