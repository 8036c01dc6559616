//! Curves and figures: what must be in the picture.
//!
//! The pictures stay in `target/tmp/figures`, to be looked at.

use quadrille::report::{Area, Axis, Picture, Plot, ReportError, Series, Style};
use resvg::{tiny_skia, usvg};
use std::path::PathBuf;

fn folder() -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("figures");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// What holds for every picture; saves it under `name` as PNG and SVG.
#[track_caller]
fn check(name: &str, picture: &Picture) {
    let (width, height) = (picture.width(), picture.height());
    let png = folder().join(format!("{name}.png"));
    picture.save(&png).unwrap();
    picture.save(folder().join(format!("{name}.svg"))).unwrap();
    let read = image::open(&png).unwrap().into_rgb8();
    assert_eq!((read.width(), read.height()), (width, height), "{name}");
    assert_eq!(read.as_raw(), picture.rgb(), "{name}: the file does not hold the picture");
    for y in 0..height {
        for x in 0..width {
            // A clipped label would leave ink on the border.
            if x < 4 || y < 4 || x + 4 >= width || y + 4 >= height {
                assert_eq!(picture.pixel(x, y).unwrap(), [255; 3], "{name}: ink at the border, ({x}, {y})");
            }
        }
    }
    check_svg(name, picture);
}

/// The SVG is well-formed, asks for no font, and shows what the PNG shows.
#[track_caller]
fn check_svg(name: &str, picture: &Picture) {
    let svg = picture.svg();
    let mut reader = quick_xml::Reader::from_str(svg);
    reader.config_mut().check_end_names = true;
    loop {
        match reader.read_event() {
            Ok(quick_xml::events::Event::Eof) => break,
            Ok(quick_xml::events::Event::Start(tag) | quick_xml::events::Event::Empty(tag)) => {
                let tag_name = tag.name().as_ref().to_owned();
                assert!(!["text", "tspan", "style", "font"].contains(&tag_name.as_str()), "{name}: <{tag_name}>");
                for attribute in tag.attributes() {
                    let attribute = attribute.unwrap_or_else(|error| panic!("{name}: {error}"));
                    let key = attribute.key.as_ref().to_owned();
                    assert!(!key.contains("font") && key != "class", "{name}: {key}");
                    let value = attribute.value.to_string();
                    assert!(!value.contains("NaN") && !value.contains("inf "), "{name}: {key}=\"{value}\"");
                    // Nothing from outside the file.
                    if key.ends_with("href") {
                        assert!(value.starts_with("data:image/png;base64,"), "{name}");
                    }
                }
            }
            Ok(_) => {}
            Err(error) => panic!("{name}: {error}"),
        }
    }
    let tree = usvg::Tree::from_str(svg, &usvg::Options::default()).unwrap();
    let mut pixels = tiny_skia::Pixmap::new(picture.width(), picture.height()).unwrap();
    let scale = picture.width() as f32 / tree.size().width();
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale, scale), &mut pixels.as_mut());
    let same = pixels.data().chunks_exact(4).zip(picture.rgb().chunks_exact(3)).all(|(a, b)| a[..3] == *b);
    assert!(same, "{name}: the SVG shows something else than the PNG");
}

fn colours(picture: &Picture, area: Area) -> impl Iterator<Item = [u8; 3]> + '_ {
    (area.y..area.y + area.height)
        .flat_map(move |y| (area.x..area.x + area.width).map(move |x| picture.pixel(x, y).unwrap()))
}

fn curve(n: usize, f: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|k| k as f64 / (n - 1) as f64).collect();
    let y = x.iter().map(|&x| f(x)).collect();
    (x, y)
}

#[test]
fn look() {
    let (x, y) = curve(200, |x| 120.0 * x * (-2.0 * x).exp());
    let (xm, ym) = curve(15, |x| 118.0 * x * (-2.0 * x).exp() + 0.3 * (30.0 * x).sin());
    let plot = Plot {
        title: "Load against opening".into(),
        x: Axis::linear("opening (mm)"),
        y: Axis::linear("load (N)"),
        series: vec![
            Series::new("model", Style::Line, x.clone(), y.clone()).with_band(vec![1.5; 200]),
            Series::new("test 1", Style::Markers, xm.clone(), ym.clone()).with_band(vec![1.0; 15]),
            Series::new("test 2", Style::LineAndMarkers, xm.clone(), ym.iter().map(|v| 0.9 * v).collect()),
            Series::new("limit", Style::Dashed, vec![0.0, 1.0], vec![20.0, 20.0]),
            Series::new("a", Style::Markers, xm.clone(), ym.iter().map(|v| 0.6 * v).collect()),
            Series::new("b", Style::Markers, xm, ym.iter().map(|v| 0.3 * v).collect()),
        ],
        notes: vec!["Band and bars: \u{b1}2 standard uncertainties.".into()],
    };
    check("load", &plot.draw().unwrap());
    let size = vec![4.0, 8.0, 16.0, 32.0, 64.0, 128.0];
    let plot = Plot {
        title: "Noise against element size".into(),
        x: Axis::log("element size (px)"),
        y: Axis::log("standard uncertainty \u{3c3} (px)"),
        series: vec![
            Series::new("formula", Style::Line, size.clone(), size.iter().map(|l| 0.4 / l).collect()),
            Series::new("measured", Style::Markers, size.clone(), size.iter().map(|l| 0.41 / l).collect())
                .with_band(vec![0.002; 6]),
        ],
        notes: vec![],
    };
    check("loglog", &plot.draw().unwrap());
}
