//! Outlines drawn as SVG.

use std::path::Path;

use usvg::tiny_skia_path::PathSegment;
use usvg::{FillRule, Group, ImageHrefResolver, Node, Options, Tree};

use super::crossing::{area_mm2, first_crossing, is_inside, signed_area};
use super::curve::Flatten;
use super::{Contour, Shape};
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};

/// Straight pieces a curve is cut into: a quarter of a circle of 50 mm radius is 0.02 mm off at most.
const PIECES: usize = 32;

/// CSS: an inch is 96 px, and 25.4 mm.
const MM_PER_PX: f64 = 25.4 / 96.0;

/// The least area of an element, mm^2: a quarter of a pixel of a GelSight Mini.
const LEAST_AREA_MM2: f64 = 1e-3;

/// The longest side of a drawing, mm.
const MAX_SIDE_MM: f64 = 500.0;

/// The outline of all elements of an SVG file in mm, centred on its own box: x right and y down, as drawn.
///
/// Lengths are the document's: `width="40mm" viewBox="0 0 40 30"` makes a unit a mm; without a unit of length
/// it is the px of CSS, 25.4/96 mm. Elements add up; each is filled by its own rule, for any colours; its
/// stroke has no width. Text is not drawn: turn it into paths first. Refuses a file without an outline, and an
/// element that is open, crosses itself or encloses nothing, by its `id` or its place in the file; and a drawing
/// wider than 500 mm.
pub fn outline(path: &Path) -> Result<Shape> {
    let file = path.display();
    let bytes = bounded_file::read(path, Kind::DRAWING)?;
    // Pictures in a drawing have no outline: what they name is not opened.
    let images = ImageHrefResolver { resolve_data: Box::new(|_, _, _| None), resolve_string: Box::new(|_, _| None) };
    let tree = Tree::from_data(&bytes, &Options { image_href_resolver: images, ..Options::default() })
        .map_err(|e| Error::invalid(file.to_string(), "an SVG drawing", e.to_string()))?;
    let mut elements = Vec::new();
    collect(tree.root(), &mut elements);
    let mut shape = Shape::default();
    for (i, element) in elements.iter().enumerate() {
        let name = if element.id().is_empty() { format!("element {}", i + 1) } else { format!("#{}", element.id()) };
        let refuse = |expected: &str, got: String| Error::invalid(format!("{file}, {name}"), expected, got);
        let region = region(element)
            .map_err(|[x, y]| refuse("a closed outline (Z at its end)", format!("an end at {x:.2}, {y:.2} mm")))?;
        if let Some([x, y]) = first_crossing(&region) {
            return Err(refuse("an outline that does not cross itself", format!("a crossing at {x:.2}, {y:.2} mm")));
        }
        let area = area_mm2(&region);
        if area.is_nan() || area < LEAST_AREA_MM2 {
            return Err(refuse(&format!("an area of {LEAST_AREA_MM2} mm^2 or more"), format!("{area} mm^2")));
        }
        shape.regions.push(region);
    }
    if shape.regions.is_empty() {
        return Err(Error::invalid(file.to_string(), "an outline (paths, not text)", "none"));
    }
    let [x_min, y_min, x_max, y_max] = shape.bounds();
    if (x_max - x_min).max(y_max - y_min) > MAX_SIDE_MM {
        let got = format!("{:.0} x {:.0} mm", x_max - x_min, y_max - y_min);
        return Err(Error::invalid(file.to_string(), format!("at most {MAX_SIDE_MM} mm each way"), got));
    }
    Ok(shape.map(|[x, y]| [x - 0.5 * (x_min + x_max), y - 0.5 * (y_min + y_max)]))
}

/// The paths of a group, in order; hidden ones are not seen.
fn collect<'a>(group: &'a Group, elements: &mut Vec<&'a usvg::Path>) {
    for node in group.children() {
        match node {
            Node::Group(group) => collect(group, elements),
            Node::Path(path) if path.is_visible() => elements.push(path),
            _ => {}
        }
    }
}

/// The contours of one element in mm, or where one of them is left open.
fn region(element: &usvg::Path) -> std::result::Result<Vec<Contour>, [f64; 2]> {
    let transform = element.abs_transform();
    let mm = |mut point: usvg::tiny_skia_path::Point| {
        transform.map_point(&mut point);
        [point.x, point.y].map(|v| f64::from(v) * MM_PER_PX)
    };
    let mut pen = Flatten::new(PIECES);
    let mut closed = true;
    let is_open = |pen: &Flatten, closed: bool| {
        let ends = pen.contours.last().and_then(|contour| Some((*contour.first()?, *contour.last()?)));
        ends.filter(|(first, last)| !closed && first != last).map(|(_, last)| last)
    };
    for segment in element.data().segments() {
        match segment {
            PathSegment::MoveTo(to) => {
                if let Some(end) = is_open(&pen, closed) {
                    return Err(end);
                }
                pen.start(mm(to));
                closed = false;
            }
            PathSegment::LineTo(to) => pen.line(mm(to)),
            PathSegment::QuadTo(control, to) => pen.quadratic(mm(control), mm(to)),
            PathSegment::CubicTo(a, b, to) => pen.cubic(mm(a), mm(b), mm(to)),
            PathSegment::Close => closed = true,
        }
    }
    if let Some(end) = is_open(&pen, closed) {
        return Err(end);
    }
    let is_nonzero = element.fill().is_none_or(|fill| fill.rule() == FillRule::NonZero);
    Ok(if is_nonzero { bounding(pen.contours) } else { pen.contours })
}

/// The contours that bound a region filled by the nonzero rule: one inside another that turns the same way
/// has the region on both sides. What is left may be filled by the even-odd rule.
fn bounding(contours: Vec<Contour>) -> Vec<Contour> {
    let winding = |contour: &Contour| signed_area(contour).signum() as i32;
    let bounds = |i: usize| {
        let around = |(j, outer): (usize, &Contour)| {
            let holds = j != i && contours[i].first().is_some_and(|point| is_inside(outer, *point));
            if holds { winding(outer) } else { 0 }
        };
        let outside: i32 = contours.iter().enumerate().map(around).sum();
        (outside == 0) != (outside + winding(&contours[i]) == 0)
    };
    let keep: Vec<bool> = (0..contours.len()).map(bounds).collect();
    contours.into_iter().zip(keep).filter_map(|(contour, keep)| keep.then_some(contour)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(body: &str) -> Result<Shape> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.svg");
        let head = "<svg xmlns='http://www.w3.org/2000/svg' width='40mm' height='30mm' viewBox='0 0 40 30'>";
        std::fs::write(&path, format!("{head}{body}</svg>")).unwrap();
        outline(&path)
    }

    fn area(shape: &Shape) -> f64 {
        shape.regions.iter().map(|region| area_mm2(region)).sum()
    }

    #[test]
    fn shapes_come_in_mm_about_their_own_middle() {
        let shape = drawn("<rect x='10' y='5' width='12' height='6'/>").unwrap();
        for (got, expected) in shape.bounds().into_iter().zip([-6.0, -3.0, 6.0, 3.0]) {
            assert!((got - expected).abs() < 1e-5, "{:?}", shape.bounds());
        }
        let circle = drawn("<g transform='translate(3 4) scale(2)'><circle r='4' fill='none' stroke='black'/></g>");
        // Eight quadratic or four cubic arcs are off by 3e-4, their chords by less.
        assert!((area(&circle.unwrap()) / (64.0 * std::f64::consts::PI) - 1.0).abs() < 1e-3);
    }

    /// A pipe that nobody writes to: a reader that opens it waits for ever.
    #[test]
    #[cfg(unix)]
    fn a_picture_that_a_drawing_names_is_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe.png");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let image = format!("<image href='{}' width='4' height='4'/>", pipe.display());
        let shape = drawn(&format!("{image}<rect width='12' height='6'/>")).unwrap();
        assert!((area(&shape) - 72.0).abs() < 1e-3);
    }

    #[test]
    fn each_filling_rule_is_its_own() {
        let squares = |rule: &str, inner: &str| {
            let body = format!("<path fill-rule='{rule}' d='M0 0H10V10H0Z {inner}'/>");
            area(&drawn(&body).unwrap())
        };
        let (same_way, other_way) = ("M3 3H7V7H3Z", "M3 3V7H7V3Z");
        for (rule, inner, expected) in [
            ("nonzero", same_way, 100.0),
            ("nonzero", other_way, 84.0),
            ("evenodd", same_way, 84.0),
            ("evenodd", other_way, 84.0),
        ] {
            assert!((squares(rule, inner) - expected).abs() < 1e-3, "{rule} {inner}");
        }
    }

    #[test]
    fn what_bounds_nothing_is_refused_by_file_and_element() {
        for (body, named, reason) in [
            ("<path id='tab' d='M0 0H10V10'/>", "#tab", "closed"),
            ("<rect width='3' height='3'/><path d='M0 0L10 10V0L0 10Z'/>", "element 2", "cross"),
            ("<path d='M0 0L10 10Z'/>", "element 1", "area"),
            ("<rect width='1' height='1e6'/>", "part.svg", "500 mm"),
            ("<text>A</text>", "part.svg", "outline"),
            ("<rect", "part.svg", "SVG"),
        ] {
            let error = drawn(body).unwrap_err().to_string();
            let fits = error.contains("part.svg") && error.contains(named) && error.contains(reason);
            assert!(fits && !error.contains('\n'), "{error}");
        }
    }
}
