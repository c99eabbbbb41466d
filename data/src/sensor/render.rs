//! One press of one part as a picture, to hold against a photograph: nothing is drawn at random but what a
//! camera adds.

use std::path::Path;

use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::pose::se2::Se2;
use crate::scene::random::frame_rng;
use crate::scene::shape::connector::Connector;
use crate::scene::shape::file::{self, Drawn, FileScale};
use crate::scene::shape::glyph::glyph;
use crate::scene::shape::{Relief, Solid};
use crate::sensor::camera::Camera;
use crate::sensor::exposure::Exposure;
use crate::sensor::gel::{Surface, TiltedPress};
use crate::sensor::geometry::{self, ContactMask};
use crate::sensor::optics::Optics;
use crate::sensor::{Fidelity, SensorSpec};
use crate::text::suggest::with_closest;

/// The gel is computed this many decay lengths beyond the view: what is there moves the view's border by 2 %.
const MARGIN_LENGTHS: f64 = 4.0;

/// A press of one part.
#[derive(Clone, Copy, Debug)]
pub struct Press<'a> {
    /// What is pressed.
    pub relief: &'a Relief,
    /// Which side of a part it is.
    pub side: Side,
    /// Where the sensor's middle is on the part.
    pub part_from_sensor: Se2,
    /// How deep the part's highest point is pressed in, mm.
    pub depth_mm: f64,
}

/// What a press looks like.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The frame of the press.
    pub frame: Frame,
    /// The same sensor at rest.
    pub at_rest: Frame,
    /// How far the gel is pushed in at each pixel, mm, rows from the top; none for [`Fidelity::Geometry`].
    pub depths_mm: Vec<f32>,
}

/// Renders a press with a sensor; what the camera adds comes from `seed`. Over a real sensor's `no_contact` frame
/// the press changes that instead of the model's. Fails where the frame has another size or the fidelity has no
/// light, and where the press is none.
pub fn render(
    spec: &SensorSpec,
    fidelity: Fidelity,
    no_contact: Option<&Frame>,
    press: &Press,
    seed: u64,
) -> Result<Rendered> {
    spec.validate()?;
    if no_contact.is_some() && fidelity < Fidelity::Optics {
        return Err(Error::invalid("no-contact frame", "fidelity optics, camera or shadow", fidelity.name()));
    }
    let (size_px, mm_per_px, pose) = (spec.frame_px, spec.mm_per_px(), press.part_from_sensor);
    let [width_mm, height_mm] = spec.field_of_view_mm;
    let half_mm = pose.x_mm.hypot(pose.y_mm) + 0.5 * width_mm.hypot(height_mm) + MARGIN_LENGTHS * spec.gel_length_mm;
    let reliefs = std::slice::from_ref(press.relief);
    if fidelity == Fidelity::Geometry {
        let mask = ContactMask::new(reliefs, press.side, half_mm, press.depth_mm)?;
        let frame = mask.view(&pose, size_px, mm_per_px);
        return Ok(Rendered { frame, at_rest: geometry::at_rest(size_px), depths_mm: Vec::new() });
    }
    let surface = Surface::solve(reliefs, press.side, half_mm, Some(spec.gel_length_mm), [press.depth_mm; 3])?;
    let depths = surface.depths(&pose, size_px, mm_per_px, TiltedPress::level(press.depth_mm));
    // Without the pixel of margin.
    let rows = depths.chunks_exact(size_px[0] + 2).skip(1).take(size_px[1]);
    let depths_mm = rows.flat_map(|row| row[1..=size_px[0]].to_vec()).collect();
    let (mut optics, camera) = (Optics::new(spec), Camera::new(spec));
    if let Some(frame) = no_contact {
        optics = optics.over(frame)?;
    }
    let exposure = Exposure { fidelity, optics: &optics, camera: &camera, mm_per_px };
    let frame = exposure.frame(&depths, &mut frame_rng(seed, 0));
    let at_rest = no_contact.cloned().unwrap_or_else(|| exposure.at_rest(&mut frame_rng(seed, 1)));
    Ok(Rendered { frame, at_rest, depths_mm })
}

/// One side of a part named `letter:A:12` (height in mm), `connector:usb-a` or as a [`Solid`] (`ball:4.7`), or of
/// a file as [`file::read`] takes it. An outline's hole is wider than it by `clearance_mm` on every side.
pub fn relief(part: &str, side: Side, scale: &FileScale, clearance_mm: f64) -> Result<Relief> {
    let of_outline = |outline| match side {
        Side::Peg => Relief::peg(outline),
        Side::Hole => Relief::hole(outline, clearance_mm),
    };
    if !(0.0..=5.0).contains(&clearance_mm) {
        return Err(Error::invalid("clearance", "0 to 5 mm", format!("{clearance_mm} mm")));
    }
    match part.split_once(':') {
        Some(("letter", text)) => {
            let given = text.split_once(':').and_then(|(letter, mm)| {
                let mut letters = letter.chars();
                let height_mm = mm.parse::<f64>().ok().filter(|mm| *mm > 0.0 && *mm <= 200.0)?;
                Some((letters.next().filter(|_| letters.next().is_none())?, height_mm))
            });
            let (letter, height_mm) = given.ok_or_else(|| Error::invalid("shape", "such as letter:A:12", part))?;
            Ok(of_outline(glyph(letter, height_mm, f64::INFINITY)?))
        }
        Some(("connector", name)) => {
            let connector = Connector::named(name)?;
            if side == Side::Peg { connector.plug() } else { Ok(connector.receptacle()) }
        }
        _ if Solid::is_name(part) => part.parse::<Solid>()?.relief(side, clearance_mm),
        Some((kind, _)) if !Path::new(part).exists() => {
            let kinds = || ["letter", "connector"].into_iter().chain(Solid::kinds());
            let expected = format!("{}, or a file", kinds().collect::<Vec<_>>().join(", "));
            Err(Error::invalid("shape", expected, with_closest(kind, kinds())))
        }
        _ => match (file::read(Path::new(part), scale)?, side) {
            (Drawn::Outline(outline), _) => Ok(of_outline(outline)),
            (heights, Side::Peg) => Ok(heights.peg()),
            (heights, Side::Hole) => Ok(heights.hole()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::calibrate::ball::BallPress;
    use crate::scene::shape::{HeightMap, Layer};

    fn press(relief: &Relief, side: Side, depth_mm: f64) -> Press<'_> {
        Press { relief, side, part_from_sensor: Se2::IDENTITY, depth_mm }
    }

    fn named(part: &str, side: Side) -> Result<Relief> {
        relief(part, side, &FileScale::default(), 0.15)
    }

    #[test]
    fn a_kind_of_part_that_is_not_known_is_refused_with_the_closest() {
        let message = named("leter:A:12", Side::Peg).unwrap_err().to_string();
        assert!(message.ends_with("or a file, got leter (did you mean letter?)"), "{message}");
    }

    #[test]
    fn a_ball_pushes_the_gel_in_as_the_closed_form_says() {
        let spec = SensorSpec::default();
        let ball = named("ball:8", Side::Peg).unwrap();
        let reach_mm = 12.0;
        // The contact's radius whose closed form is as deep as the press.
        let closed = |contact_mm: f64| BallPress::new(4.0, contact_mm, spec.gel_length_mm, reach_mm);
        let (mut low, mut high) = (0.05, 3.9);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if closed(middle).depth_mm(0.0) < 0.8 { low = middle } else { high = middle }
        }
        let closed = closed(low);
        let rendered = render(&spec, Fidelity::Optics, None, &press(&ball, Side::Peg, 0.8), 1).unwrap();
        let [width, height] = spec.frame_px;
        let mm = spec.mm_per_px();
        for (i, depth_mm) in rendered.depths_mm.iter().enumerate() {
            let x = ((i % width) as f64 - 0.5 * (width - 1) as f64) * mm[0];
            let y = ((i / width) as f64 - 0.5 * (height - 1) as f64) * mm[1];
            let expected = closed.depth_mm(x.hypot(y));
            // The gel's blur of 0.06 mm lowers the tip, and cells of 0.05 mm its height map.
            assert!((f64::from(*depth_mm) - expected).abs() < 0.015, "{x} {y}: {depth_mm}, not {expected}");
        }
    }

    #[test]
    fn a_groove_is_shaded_the_other_way_round_than_a_ridge() {
        let profile = |i: usize| (-(((i % 200) as f64 - 99.5) * 0.05 / 0.6).powi(4)).exp() as f32;
        let map = |sign: f32| {
            let heights: Vec<f32> = (0..200 * 40).map(|i| sign * 0.4 * profile(i)).collect();
            HeightMap::new([200, 40], [0.05, 0.5], &heights).unwrap()
        };
        let (groove, ridge) = (Relief::plate(map(-1.0)), Relief { layers: vec![Layer::Heights(map(1.0))] });
        let spec = SensorSpec::default();
        let change = |press: &Press| {
            let rendered = render(&spec, Fidelity::Optics, None, press, 1).unwrap();
            let change =
                rendered.frame.rgb().iter().zip(rendered.at_rest.rgb()).map(|(a, b)| f64::from(*a) - f64::from(*b));
            change.collect::<Vec<_>>()
        };
        let (in_groove, on_ridge) = (change(&press(&groove, Side::Hole, 0.3)), change(&press(&ridge, Side::Peg, 0.3)));
        // Columns half a mm to either side of the middle, on the wall; green, whose lamp is along x.
        let wall =
            |change: &[f64], column: usize| (30..90).map(|row| change[3 * (row * 160 + column) + 1]).sum::<f64>();
        for column in [75, 84] {
            let (groove, ridge) = (wall(&in_groove, column), wall(&on_ridge, column));
            assert!(groove * ridge < 0.0 && groove.abs() > 60.0, "{groove} {ridge}");
        }
        assert!(wall(&in_groove, 75) * wall(&in_groove, 84) < 0.0);
    }

    #[test]
    fn ones_own_background_is_changed_by_as_much_as_the_models() {
        let letter = named("letter:A:12", Side::Hole).unwrap();
        let press = press(&letter, Side::Hole, 0.6);
        let spec = SensorSpec { frame_px: [32, 24], ..SensorSpec::default() };
        let own = Frame::new(32, 24, (0..32 * 24 * 3).map(|i| 120 + (i % 11) as u8).collect()).unwrap();
        let over = render(&spec, Fidelity::Optics, Some(&own), &press, 1).unwrap();
        let plain = render(&spec, Fidelity::Optics, None, &press, 1).unwrap();
        assert_eq!(over.at_rest, own);
        let change =
            |rendered: &Rendered, i: usize| i32::from(rendered.frame.rgb()[i]) - i32::from(rendered.at_rest.rgb()[i]);
        for i in (0..32 * 24 * 3)
            .filter(|i| (1..255).contains(&over.frame.rgb()[*i]) && (1..255).contains(&plain.frame.rgb()[*i]))
        {
            // Each is rounded to whole counts, the model's background too.
            assert!((change(&over, i) - change(&plain, i)).abs() <= 1);
        }
        let wrong = SensorSpec { frame_px: [16, 24], ..spec.clone() };
        assert!(render(&wrong, Fidelity::Optics, Some(&own), &press, 1).unwrap_err().to_string().contains("16x24"));
        assert!(render(&spec, Fidelity::Gel, Some(&own), &press, 1).unwrap_err().to_string().contains("gel"));
    }

    #[test]
    fn a_seed_gives_the_same_picture_and_another_seed_another() {
        let usb = named("connector:usb-a", Side::Peg).unwrap();
        let spec = SensorSpec { frame_px: [64, 48], ..SensorSpec::default() };
        for &fidelity in Fidelity::ALL {
            let of = |seed| render(&spec, fidelity, None, &press(&usb, Side::Peg, 0.6), seed).unwrap().frame;
            assert_eq!(of(1), of(1));
            assert_eq!(of(1) == of(2), fidelity < Fidelity::Camera, "{fidelity:?}");
        }
    }

    #[test]
    fn what_is_no_part_is_refused_in_one_line() {
        for (part, side, reason) in [
            ("letter:A", Side::Peg, "letter:A:12"),
            ("letter:AB:12", Side::Peg, "letter:A:12"),
            ("letter:A:-3", Side::Peg, "letter:A:12"),
            ("connector:scart", Side::Hole, "usb-a"),
            ("ball:nan", Side::Peg, "ball:4.7"),
            ("ring:5:8", Side::Hole, "ring:8:5"),
            ("part.step", Side::Peg, "part.step"),
            ("map.npy", Side::Peg, "mm_per_px"),
        ] {
            let error = named(part, side).unwrap_err().to_string();
            assert!(error.contains(reason) && !error.contains('\n'), "{error}");
        }
        assert!(relief("letter:A:12", Side::Hole, &FileScale::default(), -1.0).is_err());
    }
}
