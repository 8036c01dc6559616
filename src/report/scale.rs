//! From numbers to colours and to the ticks of an axis.

use super::ReportError;
use super::scene::Rgb;
use std::sync::OnceLock;

/// Colours of the table of a palette.
const STEPS: usize = 4096;

/// A row of colours that colour-blind readers can follow too: lighter in even steps, or from both sides to the middle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Palette {
    /// Blue, green, yellow.
    #[default]
    Viridis,
    /// Blue, red, yellow.
    Plasma,
    /// Blue, grey, yellow; its middle is hard to tell from a grey image.
    Cividis,
    /// Blue, white, red, for quantities with a sign: their range is made symmetric about zero.
    BlueRed,
}

impl Palette {
    /// The colour at `t`, 0 at the lower end and 1 at the upper, in 4096 steps (more than 8 bits a channel tell apart).
    pub fn colour(self, t: f64) -> [u8; 3] {
        // A map has as many colours to look up as pixels, and a spline behind each.
        static TABLES: [OnceLock<Vec<Rgb>>; 4] = [const { OnceLock::new() }; 4];
        let gradient = match self {
            Palette::Viridis => colorous::VIRIDIS,
            Palette::Plasma => colorous::PLASMA,
            Palette::Cividis => colorous::CIVIDIS,
            Palette::BlueRed => colorous::RED_BLUE,
        };
        let table = TABLES[self as usize].get_or_init(|| {
            let share = |step: usize| step as f64 / (STEPS - 1) as f64;
            let share = |step| if self == Palette::BlueRed { 1.0 - share(step) } else { share(step) };
            (0..STEPS).map(|step| gradient.eval_continuous(share(step)).into_array()).collect()
        });
        // No number is the first colour. Rounded by cutting off: `round` is a call on processors of any age.
        table[(t.clamp(0.0, 1.0) * (STEPS - 1) as f64 + 0.5) as usize]
    }

    /// Whether the middle of the row stands for zero.
    pub fn is_diverging(self) -> bool {
        self == Palette::BlueRed
    }
}

/// The numbers that the ends of a palette stand for: `low < high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub low: f64,
    pub high: f64,
}

/// Beyond this a number is no measurement, and its differences overflow.
pub(super) const LARGEST: f64 = 1e300;

impl Range {
    pub fn new(low: f64, high: f64) -> Result<Self, ReportError> {
        let usable = low.abs() <= LARGEST && high.abs() <= LARGEST && high - low > resolution(low, high);
        if usable { Ok(Self { low, high }) } else { Err(ReportError::Range { low, high }) }
    }

    /// The range of `values`, widened about a constant so that it has an extent; `None` without values.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let ends = |range: Option<(f64, f64)>, v: f64| Some(range.map_or((v, v), |(a, b)| (v.min(a), v.max(b))));
        let (low, high) = values.fold(None, ends)?;
        if high - low > resolution(low, high) {
            return Some(Self { low, high });
        }
        let middle = low / 2.0 + high / 2.0;
        let half = if middle.abs() > 1e-290 { 0.1 * middle.abs() } else { 1.0 };
        Some(Self { low: middle - half, high: middle + half })
    }

    /// As far below zero as above, and no shorter.
    pub fn symmetric(self) -> Self {
        let reach = self.low.abs().max(self.high.abs());
        Self { low: -reach, high: reach }
    }

    /// The colour of `value`: of a palette with a middle that stands for zero, wherever zero lies in the range.
    pub fn colour(self, palette: Palette, value: f64) -> Rgb {
        let reach = self.low.abs().max(self.high.abs());
        palette.colour(if palette.is_diverging() { 0.5 + 0.5 * value / reach } else { self.fraction(value) })
    }

    /// Where `value` lies: 0 at the lower end, 1 at the upper.
    pub fn fraction(self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

/// Extents up to this are round-off; ticks would need more than ten digits to tell them apart.
fn resolution(low: f64, high: f64) -> f64 {
    (1e-8 * low.abs().max(high.abs())).max(1e-290)
}

/// A mark on an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    pub label: String,
}

/// Ticks at multiples of 1, 2 or 5 times a power of ten (not below `least_step`) within `range`, as many
/// as leave `gap` between labels on an axis of `length` px; `extent` is the size of a label along it.
/// One tick at least, for a range that holds a multiple.
pub(super) fn ticks(range: Range, length: f64, least_step: f64, gap: f64, extent: impl Fn(&str) -> f64) -> Vec<Tick> {
    let Range { low, high } = range;
    let mut ticks = Vec::new();
    for number in (2..=10).rev() {
        let exponent_and_step = round_step((high - low) / f64::from(number));
        let (exponent, step) = if exponent_and_step.1 < least_step { (0, least_step) } else { exponent_and_step };
        // A little beyond the ends: one that is itself a multiple keeps its tick.
        let (first, last) = ((low / step - 1e-6).ceil() as i64, (high / step + 1e-6).floor() as i64);
        let label = labels(range, exponent);
        ticks = (first..=last).map(|k| Tick { value: k as f64 * step, label: label(k as f64 * step) }).collect();
        let apart = step / (high - low) * length;
        let free = |pair: &[Tick]| apart >= (extent(&pair[0].label) + extent(&pair[1].label)) / 2.0 + gap;
        if ticks.windows(2).all(free) {
            return ticks;
        }
    }
    ticks.truncate(1);
    ticks
}

/// The least of 1, 2, 5, 10 times a power of ten that is not below `step`, with the power of its first digit.
fn round_step(step: f64) -> (i32, f64) {
    let exponent = step.log10().floor() as i32;
    let power = 10f64.powi(exponent);
    match step / power * (1.0 - 1e-9) {
        m if m <= 1.0 => (exponent, power),
        m if m <= 2.0 => (exponent, 2.0 * power),
        m if m <= 5.0 => (exponent, 5.0 * power),
        _ => (exponent + 1, 10.0 * power),
    }
}

/// How to write numbers of `range` that are multiples of ten to the `exponent`: all with the same number
/// of decimals; with a power of ten each where plain digits would be too many.
fn labels(range: Range, exponent: i32) -> impl Fn(f64) -> String {
    let largest = range.low.abs().max(range.high.abs());
    let plain = (1e-5..1e7).contains(&largest);
    let top = largest.log10().floor() as i32;
    move |value| {
        if value.abs() < 0.5 * 10f64.powi(exponent) {
            let decimals = if plain { (-exponent).max(0) as usize } else { 0 };
            return format!("{:.decimals$}", 0.0);
        }
        let text = if plain {
            format!("{value:.*}", (-exponent).max(0) as usize)
        } else {
            format!("{:.*}e{top}", (top - exponent).max(0) as usize, value / 10f64.powi(top))
        };
        text.replace('-', "\u{2212}") // the minus sign, as wide as a digit
    }
}

/// Ticks of a logarithmic axis over `range` (positive), as [`ticks`] places them; and the places between
/// them that get a mark without a number.
pub(super) fn log_ticks(range: Range, length: f64, gap: f64, extent: impl Fn(&str) -> f64) -> (Vec<Tick>, Vec<f64>) {
    let Range { low, high } = range;
    // Differences of logarithms: the ratio of numbers far apart may overflow.
    let decades = high.log10() - low.log10();
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let place = |v: f64| (v.log10() - low.log10()) / decades * length;
    let inside = |v: &f64| *v >= low * (1.0 - 1e-9) && *v <= high * (1.0 + 1e-9);
    let fits = |ticks: &[Tick]| {
        ticks.windows(2).all(|pair| {
            let room = (extent(&pair[0].label) + extent(&pair[1].label)) / 2.0 + gap;
            place(pair[1].value) - place(pair[0].value) >= room
        })
    };
    let marks = |multiples: &[i32], every: i32| -> Vec<Tick> {
        let decades = (first..=last).filter(|k| k % every == 0);
        let all = decades.flat_map(|k| multiples.iter().map(move |&m| (f64::from(m) * 10f64.powi(k), m, k)));
        all.filter(|(v, ..)| inside(v)).map(|(value, m, k)| Tick { value, label: log_label(m, k) }).collect()
    };
    let minor = || {
        let all = (first..=last).flat_map(|k| (2..10).map(move |m| f64::from(m) * 10f64.powi(k)));
        all.filter(inside).collect()
    };
    if decades < 3.0 {
        for multiples in [&[1, 2, 3, 4, 5, 6, 7, 8, 9][..], &[1, 2, 5], &[1, 3], &[1]] {
            let ticks = marks(multiples, 1);
            if ticks.len() >= 2 && ticks.len() <= 10 && fits(&ticks) {
                return (ticks, minor());
            }
        }
    }
    for every in 1..=last - first {
        let ticks = marks(&[1], every);
        if ticks.len() >= 2 && fits(&ticks) {
            return (ticks, if every == 1 { minor() } else { Vec::new() });
        }
    }
    // Less than a factor of about two: numbers as on a linear axis, at their places on this one.
    let mut linear = ticks(range, length, 0.0, gap, &extent);
    if !fits(&linear) {
        linear.dedup_by_key(|tick| (place(tick.value) / (3.0 * gap)).floor() as i64);
    }
    (linear, Vec::new())
}

/// `m` times ten to the `k`, in plain digits where they are few.
fn log_label(m: i32, k: i32) -> String {
    match k {
        0..=4 => format!("{}", f64::from(m) * 10f64.powi(k)),
        -4..0 => format!("{:.*}", k.unsigned_abs() as usize, f64::from(m) * 10f64.powi(k)),
        _ if m == 1 => format!("10{}", superscript(k)),
        _ => format!("{m}·10{}", superscript(k)),
    }
}

fn superscript(k: i32) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        c => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c.to_digit(10).unwrap_or(0) as usize],
    };
    k.to_string().chars().map(raised).collect()
}

/// A number in words for captions: four digits, the minus sign as wide as a digit.
pub(super) fn write_number(value: f64) -> String {
    let size = value.abs();
    // In px, degrees and strains, less is round-off.
    let text = if size < 1e-12 {
        "0".to_owned()
    } else if (1e-4..1e6).contains(&size) {
        let decimals = (3 - size.log10().floor() as i32).clamp(0, 7) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    };
    text.replace('-', "\u{2212}")
}

/// The least and the largest of `values` but for the share `cut` at either end; `None` without any.
pub(super) fn outer_ends(mut values: Vec<f64>, cut: f64) -> Option<[f64; 2]> {
    values.sort_unstable_by(f64::total_cmp);
    let cut = (cut * values.len() as f64) as usize;
    Some([*values.get(cut)?, values[values.len() - 1 - cut]])
}

/// The 1st and the 99th percentile of `values`, those of them next to it; `None` without values.
pub(super) fn percentiles(mut values: Vec<f64>) -> Option<[f64; 2]> {
    values.sort_unstable_by(f64::total_cmp);
    let at = |part: f64| values.get((values.len().saturating_sub(1) as f64 * part).round() as usize).copied();
    Some([at(0.01)?, at(0.99)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(low: f64, high: f64) -> Vec<String> {
        ticks(Range { low, high }, 900.0, 0.0, 20.0, |label| 9.0 * label.chars().count() as f64)
            .into_iter()
            .map(|tick| tick.label)
            .collect()
    }

    #[test]
    fn labels_carry_the_decimals_that_their_range_needs() {
        assert_eq!(texts(0.0, 1.0), ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1.0"]);
        assert_eq!(
            texts(-0.000123, 0.0),
            ["−0.00012", "−0.00010", "−0.00008", "−0.00006", "−0.00004", "−0.00002", "0.00000"]
        );
        assert_eq!(texts(12345.6, 12345.9)[1], "12345.65");
        assert_eq!(texts(0.0, 12345.6), ["0", "2000", "4000", "6000", "8000", "10000", "12000"]);
        assert_eq!(texts(-2.5e-9, 1.2e-9)[..2], ["−2.5e−9", "−2.0e−9"]);
        assert_eq!(texts(0.0, 3.0e8)[..3], ["0", "0.5e8", "1.0e8"]);
    }

    #[test]
    fn any_range_has_two_ticks_at_least_and_their_labels_differ() {
        for exponent in -280..280 {
            for mantissa in [1.0, 1.3, 1.99, 3.0, 4.7, 9.99] {
                for offset in [-1.0, -0.5, 0.0, 3.7, 1e3, -1e6] {
                    let width = mantissa * 10f64.powi(exponent);
                    let (low, high) = (offset * width, offset * width + width);
                    let texts = texts(low, high);
                    assert!((2..=12).contains(&texts.len()), "{low} to {high}: {texts:?}");
                    assert!(texts.windows(2).all(|pair| pair[0] != pair[1]), "{low} to {high}: {texts:?}");
                }
            }
        }
    }

    #[test]
    fn a_constant_gets_a_range_about_it() {
        assert_eq!(Range::of([2.0, 2.0].into_iter()), Some(Range { low: 1.8, high: 2.2 }));
        let noisy = Range::of([2.0, 2.0 + 1e-12].into_iter()).unwrap(); // round-off is no extent
        assert!(noisy.high - noisy.low > 0.3, "{noisy:?}");
        assert_eq!(Range::of([0.0].into_iter()), Some(Range { low: -1.0, high: 1.0 }));
        assert_eq!(Range::of(std::iter::empty()), None);
    }
}
