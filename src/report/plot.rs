//! Curves: several series over one pair of axes.

use super::axes::{BORDER, GAP, Letters, Lines, Side, SideAxis};
use super::bar::BAR_WIDTH;
use super::cells::Cells;
use super::scale::{LARGEST, Range, Tick, log_ticks, ticks};
use super::scene::{Anchor, BLACK, COLOURS, Path, Rect, Rgb, Scene, Stroke, WHITE};
use super::{Look, Picture, ReportError};

/// Size of the rectangle between the axes.
const SIZE: [i32; 2] = [680, 420];
/// Length of a line in the legend.
const SAMPLE: i32 = 34;
const GRID: Rgb = [224, 224, 224];
/// Half the size of a marker.
const MARK: f64 = 4.0;
/// Points nearer than this to the last one drawn are not drawn: nobody can see them.
const NEAR: f64 = 0.1;

/// Curves over a pair of axes, with a legend when a series has a name.
///
/// ```
/// use quadrille::report::{Axis, Plot, PlotSeries, Style};
/// let size: Vec<f64> = vec![8.0, 16.0, 32.0, 64.0];
/// let sigma: Vec<f64> = size.iter().map(|l| 0.4 / l).collect();
/// let plot = Plot {
///     title: "Noise against element size".into(),
///     x: Axis::log("element size (px)"),
///     y: Axis::log("standard uncertainty (px)"),
///     series: vec![
///         PlotSeries::new("formula", Style::Line, size.clone(), sigma.clone()),
///         PlotSeries::new("measured", Style::Markers, size, sigma).with_band(vec![0.002; 4]),
///     ],
///     notes: vec!["Bars: +-2 standard deviations of ten repetitions.".into()],
///     ..Plot::default()
/// };
/// let picture = plot.draw().unwrap();
/// assert!(picture.svg().starts_with("<svg"));
/// // picture.save("noise.svg") and picture.save("noise.png") write the same drawing.
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plot {
    /// Above the picture; broken into lines where it is long.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Numbers as colours, behind the curves.
    pub cells: Option<Cells>,
    /// The curves, drawn in this order.
    pub series: Vec<PlotSeries>,
    /// Lines of text below the picture: what a caption says where figures are for print or a slide.
    pub notes: Vec<String>,
    /// What must not be overlooked: above the picture, whatever it is for.
    pub warnings: Vec<String>,
}

/// An axis of a [`Plot`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Axis {
    /// The quantity and its unit, as `load (N)`.
    pub label: String,
    /// Whether equal factors stand equally far apart; a note then says how many points are not shown, at or below zero.
    pub log: bool,
    /// The values at the ends; `None` for a little more than the values of all series.
    pub range: Option<(f64, f64)>,
}

impl<T: AsRef<str>> From<T> for Axis {
    /// A linear axis over all values.
    fn from(label: T) -> Self {
        Self::linear(label.as_ref())
    }
}

impl Axis {
    /// A linear axis over all values.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), log: false, range: None }
    }

    /// A logarithmic axis over all positive values.
    pub fn log(label: impl Into<String>) -> Self {
        Self { log: true, ..Self::linear(label) }
    }

    /// Whether `value` has a place on it.
    fn can_show(&self, value: f64) -> bool {
        value.abs() <= LARGEST && (!self.log || value > 0.0)
    }

    /// The same axis from `low` to `high`; what lies beyond is cut off.
    pub fn with_range(self, low: f64, high: f64) -> Self {
        Self { range: Some((low, high)), ..self }
    }
}

/// One curve of a [`Plot`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlotSeries {
    /// In the legend; nothing stands there when it is empty.
    pub name: String,
    /// Abscissae.
    pub x: Vec<f64>,
    /// Ordinates. The curve has a gap where one is not finite.
    pub y: Vec<f64>,
    /// How far a band around lines, or the error bars of markers, reach below and above `y`, in its unit.
    pub band: Option<[Vec<f64>; 2]>,
    /// How it is drawn.
    pub style: Style,
    /// Number of its colour (and marker); its place among the series unless given.
    pub colour: Option<usize>,
}

/// How a [`PlotSeries`] is drawn. Colours and markers follow the order of the series; they differ for
/// colour-blind readers and in print without colours, too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Style {
    /// A full line.
    #[default]
    Line,
    /// A dashed line.
    Dashed,
    /// Points.
    Markers,
    /// Points joined by a line.
    LineAndMarkers,
}

impl PlotSeries {
    /// A curve without a band.
    pub fn new(name: impl Into<String>, style: Style, x: Vec<f64>, y: Vec<f64>) -> Self {
        Self { name: name.into(), x, y, band: None, style, colour: None }
    }

    /// The same curve with a band of plus and minus `half`.
    pub fn with_band(self, half: Vec<f64>) -> Self {
        Self { band: Some([half.clone(), half]), ..self }
    }

    /// The same curve with a band from `low` to `high`; where they are not finite there is none, and the name says so.
    pub fn with_limits(self, low: &[f64], high: &[f64]) -> Self {
        if low.iter().chain(high).any(|end| !end.is_finite()) {
            let what = if self.name.is_empty() { "band" } else { &self.name };
            return Self { name: format!("{what}: not determined"), ..self };
        }
        let below = self.y.iter().zip(low).map(|(y, low)| y - low).collect();
        let above = self.y.iter().zip(high).map(|(y, high)| high - y).collect();
        Self { band: Some([below, above]), ..self }
    }

    fn has_line(&self) -> bool {
        self.style != Style::Markers
    }

    fn has_markers(&self) -> bool {
        matches!(self.style, Style::Markers | Style::LineAndMarkers)
    }

    /// Whether a band lies around its line.
    fn is_banded(&self) -> bool {
        self.band.is_some() && !self.has_markers()
    }

    /// Lower and upper edge of the band at a point.
    fn edges(&self, at: usize) -> [f64; 2] {
        let reach = |side: usize| self.band.as_ref().map_or(0.0, |band| band[side][at]).abs();
        [self.y[at] - reach(0), self.y[at] + reach(1)]
    }
}

/// An axis with its ends, and where they stand.
struct Scale {
    range: Range,
    log: bool,
    /// Places of the ends, units of the sheet.
    ends: [f64; 2],
}

impl Scale {
    /// The axis over `values` (which are finite, and positive on a logarithmic axis).
    fn new(axis: &Axis, values: impl Iterator<Item = f64>, ends: [f64; 2]) -> Result<Option<Self>, ReportError> {
        let range = match axis.range {
            Some((low, high)) if axis.log && low <= 0.0 => return Err(ReportError::LogRange { low, high }),
            Some((low, high)) => Some(Range::new(low, high)?),
            None => Range::of(values).map(|range| widen(range, axis.log)),
        };
        Ok(range.map(|range| Self { range, log: axis.log, ends }))
    }

    /// Where `value` stands; far beyond the ends it stays at a finite place.
    fn at(&self, value: f64) -> f64 {
        let part = if self.log {
            let [low, high, value] = [self.range.low, self.range.high, value.max(f64::MIN_POSITIVE)].map(f64::ln);
            (value - low) / (high - low)
        } else {
            self.range.fraction(value)
        };
        self.ends[0] + part.clamp(-20.0, 20.0) * (self.ends[1] - self.ends[0])
    }

    fn ticks(&self, gap: f64, extent: impl Fn(&str) -> f64) -> (Vec<Tick>, Vec<f64>) {
        let length = (self.ends[1] - self.ends[0]).abs();
        if self.log {
            log_ticks(self.range, length, gap, extent)
        } else {
            (ticks(self.range, length, 0.0, gap, extent), Vec::new())
        }
    }
}

/// A little room at both ends, so that no point sits on the frame.
fn widen(range: Range, log: bool) -> Range {
    let Range { low, high } = range;
    if log {
        let room = (0.04 * (high.ln() - low.ln())).exp();
        let wide = Range { low: low / room, high: high * room };
        return if wide.low > 0.0 && wide.high <= LARGEST { wide } else { range };
    }
    let room = 0.04 * (high - low);
    Range { low: low - room, high: high + room }
}

impl Plot {
    /// Curves over two axes, without notes; a label alone is that of a linear axis.
    pub fn new(
        title: impl Into<String>,
        x: impl Into<Axis>,
        y: impl Into<Axis>,
        series: impl IntoIterator<Item = PlotSeries>,
    ) -> Self {
        let series = series.into_iter().collect();
        Self { title: title.into(), x: x.into(), y: y.into(), series, ..Self::default() }
    }

    /// The same plot with a line of text below it.
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// Draws the curves.
    ///
    /// # Errors
    /// A series whose lists differ in length, and a range without extent or, on a logarithmic axis, from zero or below.
    pub fn draw(&self) -> Result<Picture, ReportError> {
        self.draw_for(Look::chosen())
    }

    /// [`Plot::draw`] for a screen, a column or a slide, whatever is chosen.
    ///
    /// # Errors
    /// Those of [`Plot::draw`].
    pub fn draw_for(&self, look: Look) -> Result<Picture, ReportError> {
        let size = SIZE.map(|side| look.side(f64::from(side)) as i32);
        let picture = self.draw_in(size, look)?;
        // What stands beside the axes is known now: they get what the sheet leaves them.
        let Some(sheet) = look.sheet() else { return Ok(picture) };
        let spare = sheet - picture.sheet()[0] as i32;
        self.draw_in([size[0] + spare, size[1]], look)
    }

    /// Whether a point of a series can be shown.
    fn shows(&self, series: &PlotSeries, at: usize) -> bool {
        self.x.can_show(series.x[at]) && self.y.can_show(series.y[at])
    }

    /// The stretches of a series without a gap, as numbers of its points.
    fn stretches(&self, series: &PlotSeries) -> Vec<Vec<usize>> {
        let points: Vec<usize> = (0..series.x.len()).collect();
        let stretches = points.split(|&at| !self.shows(series, at));
        stretches.filter(|stretch| !stretch.is_empty()).map(<[usize]>::to_vec).collect()
    }

    /// The values at the ends of the horizontal axis; `None` where there is nothing to show.
    pub(super) fn ends_of_x(&self) -> Result<Option<[f64; 2]>, ReportError> {
        let points = self.series.iter().flat_map(|s| (0..s.x.len()).filter(|&at| self.shows(s, at)).map(|at| s.x[at]));
        Ok(Scale::new(&self.x, points, [0.0, 1.0])?.map(|scale| [scale.range.low, scale.range.high]))
    }

    /// The curves with `size` (at least 120 each way) between the axes; letters keep their size.
    pub(super) fn draw_in(&self, size: [i32; 2], look: Look) -> Result<Picture, ReportError> {
        for PlotSeries { name, x, y, band, .. } in &self.series {
            let (x, y) = (x.len(), y.len());
            let band = band.iter().flatten().map(Vec::len).find(|&side| side != x).unwrap_or(x);
            if y != x || band != x {
                return Err(ReportError::Series { name: name.clone(), x, y, band });
            }
        }
        let [width, height] = size.map(|side| side.max(120));
        let points = || {
            self.series.iter().flat_map(|s| (0..s.x.len()).map(move |at| (s, at))).filter(|(s, at)| self.shows(s, *at))
        };
        // What is given and finite, but not shown: at or below zero on a logarithmic axis.
        let finite = |s: &PlotSeries, at: usize| s.x[at].abs() <= LARGEST && s.y[at].abs() <= LARGEST;
        let all = self.series.iter().map(|s| (0..s.x.len()).filter(|&at| finite(s, at)).count()).sum::<usize>();
        let hidden = all - points().count();

        let reach = points().flat_map(|(s, at)| s.edges(at).into_iter().chain([s.y[at]]));
        // Cells reach to the ends of the axes.
        let fill = |axis: &Axis, places: Option<&Vec<f64>>| match places.map(|places| Cells::edges(places)).as_deref() {
            Some([first, .., last]) if axis.range.is_none() => axis.clone().with_range(*first, *last),
            _ => axis.clone(),
        };
        let of_cells =
            [fill(&self.x, self.cells.as_ref().map(|c| &c.x)), fill(&self.y, self.cells.as_ref().map(|c| &c.y))];
        let x = Scale::new(&of_cells[0], points().map(|(s, at)| s.x[at]), [0.0, f64::from(width)])?;
        let y = Scale::new(&of_cells[1], reach.filter(|&v| self.y.can_show(v)), [f64::from(height), 0.0])?;
        let bar = self.cells.as_ref().and_then(Cells::bar);

        let letters = Letters::new(look);
        let inner = width + 90.min(width / 8);
        let mut warnings = self.warnings.clone();
        if hidden > 0 {
            let points = if hidden == 1 { "1 point" } else { &format!("{hidden} points") };
            warnings.push(format!("{points} at or below zero cannot be shown on a logarithmic axis"));
        }
        if points().next().is_none() && bar.is_none() {
            warnings.push("no value to show".to_owned());
        }
        let (mut head, mut foot) = (Lines::default(), Lines::default());
        head.title(&letters, &self.title, inner);
        head.warnings(&letters, &warnings, inner);
        foot.notes(&letters, &self.notes, inner);
        let legend = Legend::new(&letters, &self.series, inner);

        let across = |text: &str| letters.small.width(text);
        let upright = |_: &str| f64::from(letters.small.digit());
        let axis = |side, scale: &Option<Scale>, label: &str, room: i32, gap, extent: &dyn Fn(&str) -> f64| {
            let titled = |axis: SideAxis| axis.titled(&letters, label, room);
            let Some(scale) = scale else { return titled(SideAxis::new(side, &[], |v| v, label)) };
            let (ticks, minor) = scale.ticks(gap, extent);
            let mut axis = titled(SideAxis::new(side, &ticks, |v| scale.at(v), label));
            axis.minor = minor.into_iter().map(|v| scale.at(v)).collect();
            axis
        };
        let bottom = axis(Side::Bottom, &x, &self.x.label, inner, 24.0, &across);
        let left = axis(Side::Left, &y, &self.y.label, height + 40, 14.0, &upright);

        let beside = bottom.overhang(&letters, width);
        let bar = self.cells.as_ref().zip(bar).map(|(cells, bar)| (cells, bar.axis(&letters, height, false), bar));
        let of_bar = bar.as_ref().map_or(0, |(_, axis, _)| 2 * GAP + BAR_WIDTH + axis.thickness(&letters));
        let margin = [left.thickness(&letters).max(beside), of_bar.max(beside.max(24))];
        let over = left.overhang(&letters, height);
        let gap = |part: i32| if part > 0 { part + GAP } else { 0 };
        let top = BORDER + gap(head.height(&letters)) + gap(legend.height) + over;
        let rect = Rect { x: BORDER + margin[0], y: top, width, height };
        let sheet = [
            (rect.right() + margin[1] + BORDER).max(inner + 2 * BORDER),
            rect.bottom() + bottom.thickness(&letters).max(over) + 2 * GAP + foot.height(&letters) + BORDER,
        ];
        let mut scene = Scene::new(sheet[0], sheet[1]);
        head.draw(&mut scene, &letters, Anchor::Middle, f64::from(sheet[0]) / 2.0, BORDER);
        legend.draw(&mut scene, &letters, rect, BORDER + gap(head.height(&letters)));
        let below = rect.bottom() + bottom.thickness(&letters).max(over) + 2 * GAP;
        foot.draw(&mut scene, &letters, Anchor::Start, f64::from(BORDER), below);

        if let (Some(x), Some(y)) = (&x, &y) {
            grid(&mut scene, rect, &bottom, &left);
            if let Some((cells, axis, bar)) = &bar {
                let size = [rect.width as u32, rect.height as u32];
                let ends = [x, y].map(|scale| [scale.range.low, scale.range.high]);
                let at = [rect.x, rect.y, rect.width, rect.height].map(f64::from);
                scene.image(at, &cells.png(bar, ends, size), 1.0);
                let beside = Rect { x: rect.right() + 2 * GAP, width: BAR_WIDTH, ..rect };
                bar.draw(&mut scene, beside, 255);
                axis.draw(&mut scene, &letters, beside);
            }
            scene.clip(rect);
            let place = |a: f64, b: f64| [f64::from(rect.x) + x.at(a), f64::from(rect.y) + y.at(b)];
            let drawn = || {
                let numbered = self.series.iter().enumerate().map(|(k, series)| (series, series.colour.unwrap_or(k)));
                numbered.map(|(series, number)| (series, number, self.stretches(series)))
            };
            for (series, number, stretches) in drawn().filter(|(series, ..)| series.is_banded()) {
                draw_band(&mut scene, series, number, &stretches, &place);
            }
            for (series, number, stretches) in drawn() {
                draw_series(&mut scene, series, number, &stretches, &place);
            }
            scene.unclip();
        }
        scene.frame(rect, BLACK);
        bottom.draw(&mut scene, &letters, rect);
        left.draw(&mut scene, &letters, rect);
        Ok(scene.finish((&self.title, &self.notes), look, rect, None, 1).with_warnings(warnings, look))
    }
}

fn grid(scene: &mut Scene, rect: Rect, bottom: &SideAxis, left: &SideAxis) {
    for (place, _) in &bottom.ticks {
        let x = rect.x + (place.floor() as i32).clamp(0, rect.width - 1);
        scene.fill(Rect { x, width: 1, ..rect }, GRID);
    }
    for (place, _) in &left.ticks {
        let y = rect.y + (place.floor() as i32).clamp(0, rect.height - 1);
        scene.fill(Rect { y, height: 1, ..rect }, GRID);
    }
}

fn colour_of(number: usize) -> Rgb {
    COLOURS[number % COLOURS.len()]
}

/// From values to the sheet.
type Place<'a> = &'a dyn Fn(f64, f64) -> [f64; 2];

fn draw_band(scene: &mut Scene, series: &PlotSeries, number: usize, stretches: &[Vec<usize>], place: Place<'_>) {
    let mut path = Path::default();
    for stretch in stretches {
        let edge = |at: &usize, side: usize| place(series.x[*at], series.edges(*at)[side]);
        let upper = stretch.iter().map(|at| edge(at, 1));
        path.polygon(upper.chain(stretch.iter().rev().map(|at| edge(at, 0))));
    }
    scene.area(&path, colour_of(number), 0.22);
}

fn draw_series(scene: &mut Scene, series: &PlotSeries, number: usize, stretches: &[Vec<usize>], place: Place<'_>) {
    let colour = colour_of(number);
    if series.has_line() {
        let (mut path, mut alone) = (Path::default(), Path::default());
        for stretch in stretches {
            let mut kept: Vec<[f64; 2]> = Vec::with_capacity(stretch.len());
            for (k, &at) in stretch.iter().enumerate() {
                let point = place(series.x[at], series.y[at]);
                let far = |last: &[f64; 2]| (point[0] - last[0]).abs().max((point[1] - last[1]).abs()) > NEAR;
                if k + 1 == stretch.len() || kept.last().is_none_or(far) {
                    kept.push(point);
                }
            }
            // A point between two gaps would be nothing as a line.
            if stretch.len() == 1 && !series.has_markers() {
                alone.circle(kept[0], 2.0);
            }
            path.line(kept);
        }
        scene.stroke(&path, &line_stroke(series, colour));
        scene.area(&alone, colour, 1.0);
    }
    if series.has_markers() {
        let (mut bars, mut marks) = (Path::default(), Path::default());
        for &at in stretches.iter().flatten() {
            let (x, y) = (series.x[at], series.y[at]);
            let [low, high] = series.edges(at);
            if low < high {
                let ends = [place(x, low), place(x, high)];
                bars.line(ends);
                ends.iter().for_each(|[x, y]| bars.line([[x - MARK, *y], [x + MARK, *y]]));
            }
            mark(&mut marks, number, place(x, y));
        }
        draw_marks(scene, &bars, &marks, colour);
    }
}

fn draw_marks(scene: &mut Scene, bars: &Path, marks: &Path, colour: Rgb) {
    scene.stroke(bars, &Stroke::new(colour, 1.2));
    scene.area(marks, colour, 1.0);
    scene.stroke(marks, &Stroke::new(WHITE, 0.6));
}

fn line_stroke(series: &PlotSeries, colour: Rgb) -> Stroke {
    let dash: &[f64] = if series.style == Style::Dashed { &[8.0, 5.0] } else { &[] };
    Stroke { dash, ..Stroke::new(colour, 2.0) }
}

/// The marker of series `number`: circle, square, triangle, diamond, triangle downwards.
fn mark(path: &mut Path, number: usize, [x, y]: [f64; 2]) {
    let corners: &[[f64; 2]] = match number % 5 {
        0 => return path.circle([x, y], MARK),
        1 => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
        2 => &[[0.0, -1.2], [1.1, 0.8], [-1.1, 0.8]],
        3 => &[[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]],
        _ => &[[0.0, 1.2], [1.1, -0.8], [-1.1, -0.8]],
    };
    path.polygon(corners.iter().map(|[a, b]| [x + MARK * a, y + MARK * b]));
}

/// Names of the series in rows above the axes, where they cannot cover a curve.
struct Legend<'a> {
    /// Series, number, name as it fits, and its place from the upper left corner.
    entries: Vec<(&'a PlotSeries, usize, String, [i32; 2])>,
    height: i32,
}

impl<'a> Legend<'a> {
    fn new(letters: &Letters, series: &'a [PlotSeries], width: i32) -> Self {
        let (mut x, mut row) = (0, 0);
        let mut entries = Vec::new();
        let line = letters.small.line() + 2;
        for (place, series) in series.iter().enumerate().filter(|(_, series)| !series.name.is_empty()) {
            let number = series.colour.unwrap_or(place);
            let name = letters.small.fit(&series.name, f64::from(width - SAMPLE - GAP));
            let length = SAMPLE + GAP + letters.small.width(&name).ceil() as i32;
            if x > 0 && x + length > width {
                (x, row) = (0, row + 1);
            }
            entries.push((series, number, name, [x, row * line]));
            x += length + 4 * GAP;
        }
        let height = if entries.is_empty() { 0 } else { (row + 1) * line };
        Self { entries, height }
    }

    fn draw(&self, scene: &mut Scene, letters: &Letters, rect: Rect, top: i32) {
        let longest = self.entries.iter().map(|(.., name, at)| at[0] + SAMPLE + GAP + letters.small.width(name) as i32);
        // From the left end of the axes, or further to the left where a row is longer than they are.
        let left = rect.x.min(rect.right() - longest.max().unwrap_or(0)).max(BORDER);
        for (series, number, name, [x, y]) in &self.entries {
            let (x, y) = (f64::from(left + x), f64::from(top + y));
            let middle = y + f64::from(letters.small.em) * 0.68;
            let colour = colour_of(*number);
            let mut sample = Path::default();
            sample.line([[x, middle], [x + f64::from(SAMPLE), middle]]);
            if series.has_line() {
                if series.is_banded() {
                    scene.stroke(&sample, &Stroke { opacity: 0.22, ..Stroke::new(colour, 12.0) });
                }
                scene.stroke(&sample, &line_stroke(series, colour));
            }
            if series.has_markers() {
                let (mut bar, mut marks) = (Path::default(), Path::default());
                let centre = x + f64::from(SAMPLE) / 2.0;
                if series.band.is_some() {
                    bar.line([[centre, middle - 8.0], [centre, middle + 8.0]]);
                }
                mark(&mut marks, *number, [centre, middle]);
                draw_marks(scene, &bar, &marks, colour);
            }
            let foot = [x + f64::from(SAMPLE + GAP), y + f64::from(letters.small.em)];
            scene.text(&letters.small, name, Anchor::Start, foot, BLACK);
        }
    }
}
