//! The simulated sensor on a scene's parts: what a robot would see.

use std::sync::OnceLock;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::scene::{Parts, Scene};
use crate::se2::Se2;
use crate::sensor::camera::{CONTACT, Camera, LayerLines, to_frame};
use crate::sensor::gel::Surface;
use crate::sensor::optics::Optics;
use crate::sensor::{Fidelity, SensorSpec};
use crate::touch::Side;

/// Exposures averaged into the no-contact frame, as one would take it on a bench.
const REST_EXPOSURES: u64 = 8;

/// A scene that can be touched. A surface is solved when its part is first touched, and kept.
#[derive(Debug)]
pub struct Simulator {
    scene: Scene,
    parts: Vec<String>,
    board_seed: u64,
    camera: Camera,
    optics: Optics,
    surfaces: Vec<[OnceLock<Result<Surface>>; 2]>,
    symmetric: Vec<OnceLock<bool>>,
    rigs: Vec<OnceLock<(f64, Optics)>>,
}

/// The random numbers of one frame: those of `seed`, on a stream of its own.
pub fn frame_rng(seed: u64, frame: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(frame);
    rng
}

impl Simulator {
    /// Prepares a scene; `board_seed` draws its MAZE boards.
    pub fn new(scene: Scene, board_seed: u64) -> Result<Self> {
        scene.validate()?;
        let parts = scene.part_names();
        Ok(Self {
            camera: Camera::new(&scene.sensor),
            optics: Optics::new(&scene.sensor),
            surfaces: parts.iter().map(|_| Default::default()).collect(),
            symmetric: parts.iter().map(|_| OnceLock::new()).collect(),
            rigs: parts.iter().map(|_| OnceLock::new()).collect(),
            parts,
            board_seed,
            scene,
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Names of the parts.
    pub fn parts(&self) -> &[String] {
        &self.parts
    }

    /// Whether a part looks the same after half a turn: its pose is then known only up to one.
    pub fn is_half_turn_symmetric(&self, part: usize) -> bool {
        let look = || self.scene.shape(part, self.board_seed).is_ok_and(|shape| shape.is_half_turn_symmetric());
        self.symmetric.get(part).is_some_and(|known| *known.get_or_init(look))
    }

    /// The sensor at rest: the mean of a few exposures.
    pub fn no_contact(&self, seed: u64) -> Frame {
        let size_px = self.scene.sensor.frame_px;
        if self.scene.fidelity < Fidelity::Camera {
            let depths = vec![0.0; (size_px[0] + 2) * (size_px[1] + 2)];
            return self.picture(&depths, &self.optics, &mut frame_rng(seed, 0));
        }
        let mut mean = vec![0.0_f32; 3 * size_px[0] * size_px[1]];
        for exposure in 0..REST_EXPOSURES {
            let frame = self.camera.expose(self.optics.at_rest().to_vec(), &mut frame_rng(seed, exposure));
            mean.iter_mut().zip(frame.rgb()).for_each(|(m, v)| *m += f32::from(*v) / REST_EXPOSURES as f32);
        }
        to_frame(&mean, size_px)
    }

    /// Presses the sensor onto one side of a part. Depth, tilt, place, texture, gain and noise are drawn
    /// from `rng`, so that two touches at one pose differ as real ones do.
    pub fn touch(&self, part: usize, side: Side, part_from_sensor: &Se2, rng: &mut ChaCha8Rng) -> Result<Frame> {
        let spec = &self.scene.sensor;
        if part >= self.parts.len() || !part_from_sensor.is_finite() {
            let got = format!("part {part} at {part_from_sensor:?}");
            return Err(Error::invalid("touch", format!("one of {} parts, a finite pose", self.parts.len()), got));
        }
        let (gel_length_mm, optics) = self.rig(part);
        let surface = self.surface(part, side, gel_length_mm)?;
        let mut jitter = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
        let slipped = Se2::new(jitter(spec.place_jitter_mm), jitter(spec.place_jitter_mm), 0.0);
        let depth_mm = (spec.depth_mm + jitter(spec.depth_jitter_mm)).max(0.0);
        let tilt = [0, 1].map(|_| jitter(spec.tilt_jitter_deg).to_radians().tan());
        let mut depths = surface.view(&(*part_from_sensor * slipped), spec.frame_px, spec.mm_per_px());
        if self.scene.fidelity == Fidelity::Camera && depth_mm > 0.0 {
            let amplitude_mm = spec.texture_mm[0] + (spec.texture_mm[1] - spec.texture_mm[0]) * rng.random::<f64>();
            // Peg and hole are printed apart, each with its own lines.
            let lines = LayerLines::draw(&mut frame_rng(
                self.board_seed ^ 0x6c69_6e65,
                2 * part as u64 + u64::from(side == Side::Peg),
            ));
            lines.add(&mut depths, spec, part_from_sensor.theta_rad, amplitude_mm / depth_mm, rng);
        }
        // Which cells touch is told from the unit press: a tilt leaves them in contact.
        if self.scene.fidelity > Fidelity::Geometry {
            press(&mut depths, spec, depth_mm, tilt);
        }
        Ok(self.picture(&depths, optics, rng))
    }

    /// Depths (of a unit press for `Geometry`, else mm) to a frame, as far as the scene's fidelity goes.
    fn picture(&self, depths: &[f32], optics: &Optics, rng: &mut ChaCha8Rng) -> Frame {
        let spec = &self.scene.sensor;
        let grey = |level: &dyn Fn(f32) -> f32| {
            let [width, height] = spec.frame_px;
            let inner = (0..height).flat_map(|row| &depths[(row + 1) * (width + 2) + 1..][..width]);
            to_frame(&inner.flat_map(|depth| [level(*depth); 3]).collect::<Vec<_>>(), spec.frame_px)
        };
        match self.scene.fidelity {
            // The picture at rest keeps a corner of another grey: a constant frame is a broken camera.
            Fidelity::Geometry => mark(grey(&|depth| if depth > CONTACT { 200.0 } else { 60.0 })),
            Fidelity::Gel => mark(grey(&|depth| 60.0 + 150.0 * depth)),
            Fidelity::Optics => to_frame(&optics.shade(depths, spec.mm_per_px()), spec.frame_px),
            Fidelity::Camera => self.camera.expose(optics.shade(depths, spec.mm_per_px()), rng),
        }
    }

    fn surface(&self, part: usize, side: Side, gel_length_mm: f64) -> Result<&Surface> {
        let solved = self.surfaces[part][usize::from(side == Side::Peg)].get_or_init(|| {
            let shape = self.scene.shape(part, self.board_seed)?;
            let gel_length_mm = (self.scene.fidelity > Fidelity::Geometry).then_some(gel_length_mm);
            Surface::solve(&shape, side, self.scene.half_extent_mm(), gel_length_mm, self.scene.clearance_mm)
        });
        solved.as_ref().map_err(|e| Error::invalid(&self.parts[part], "a part that can be pressed", e.to_string()))
    }

    /// Gel and lamps under which a part is touched: the scene's own for letters; for a MAZE board drawn
    /// round them, since another gel and other lamps are what a trained model meets.
    fn rig(&self, part: usize) -> (f64, &Optics) {
        let Parts::Maze(boards) = &self.scene.parts else {
            return (self.scene.sensor.gel_length_mm, &self.optics);
        };
        let (gel_length_mm, optics) = self.rigs[part].get_or_init(|| {
            let mut rng = frame_rng(self.board_seed, u64::MAX - part as u64);
            let [shortest, longest] = boards.gel_length_mm;
            let gel_length_mm = shortest + (longest - shortest) * rng.random::<f64>();
            let mut around = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
            let spec = SensorSpec {
                // Two Minis' fitted lamps differ by some 4 to 17 degrees and 10 % of brightness.
                lamp_counts: self.scene.sensor.lamp_counts.map(|counts| counts * (1.0 + around(0.15))),
                lamp_deg: self.scene.sensor.lamp_deg.map(|deg| deg + around(10.0)),
                ..self.scene.sensor.clone()
            };
            (gel_length_mm, Optics::new(&spec))
        });
        (*gel_length_mm, optics)
    }
}

/// Turns unit depths into mm: `depth + tilt . place`, never negative.
fn press(depths: &mut [f32], spec: &SensorSpec, depth_mm: f64, tilt: [f64; 2]) {
    let width = spec.frame_px[0] + 2;
    let mm_per_px = spec.mm_per_px();
    let step = (tilt[0] * mm_per_px[0]) as f32;
    for (row, line) in depths.chunks_exact_mut(width).enumerate() {
        let y = (row as f64 - 0.5 * (spec.frame_px[1] + 1) as f64) * mm_per_px[1];
        let x = -0.5 * (width - 1) as f64 * mm_per_px[0];
        let mut here = (depth_mm + tilt[0] * x + tilt[1] * y) as f32;
        for depth in line {
            *depth *= here.max(0.0);
            here += step;
        }
    }
}

fn mark(frame: Frame) -> Frame {
    let (width, height) = (frame.width_px(), frame.height_px());
    let mut rgb = frame.rgb().to_vec();
    rgb[..3].fill(90);
    Frame::from_parts(width, height, rgb)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Background, Preprocessing, TactileImage};

    fn simulator(name: &str) -> Simulator {
        Simulator::new(Scene::preset(name).unwrap(), 1).unwrap()
    }

    fn image(
        simulator: &Simulator,
        background: &Background,
        part: usize,
        side: Side,
        pose: &Se2,
        seed: u64,
    ) -> TactileImage {
        let frame = simulator.touch(part, side, pose, &mut frame_rng(seed, part as u64)).unwrap();
        background.tactile_image(&frame).unwrap()
    }

    #[test]
    fn the_same_seed_gives_the_same_frame_and_another_does_not() {
        let simulator = simulator("alphabet-small");
        let touch = |seed| simulator.touch(0, Side::Hole, &Se2::IDENTITY, &mut frame_rng(seed, 0)).unwrap();
        assert_eq!(touch(1), touch(1));
        assert_ne!(touch(1), touch(2));
    }

    #[test]
    fn over_nothing_and_on_the_plate_the_view_is_blank() {
        let mut scene = Scene::preset("alphabet-large").unwrap();
        scene.parts =
            Parts::Letters(crate::scene::Letters { letters: "I".into(), height_mm: 32.0, max_width_mm: 40.0 });
        let simulator = Simulator::new(scene, 1).unwrap();
        let background = Background::new(&simulator.no_contact(3), &Preprocessing::counts([40, 30])).unwrap();
        for side in [Side::Peg, Side::Hole] {
            let beside = image(&simulator, &background, 0, side, &Se2::new(20.0, 0.0, 0.0), 5);
            assert!(beside.edge_share < 0.02, "{side:?}: {}", beside.edge_share);
            let on_edge = image(&simulator, &background, 0, side, &Se2::new(3.0, 0.0, 0.0), 5);
            assert!(on_edge.edge_share > 0.05, "{side:?}: {}", on_edge.edge_share);
        }
    }

    /// A hole image is neither its peg's nor the negative of it: nearest neighbours by pixel must fail,
    /// and the colours at one pose run against each other.
    #[test]
    fn pixels_do_not_tell_which_peg_fits() {
        let simulator = simulator("alphabet-small");
        let background = Background::new(&simulator.no_contact(3), &Preprocessing::counts([40, 30])).unwrap();
        let grid = simulator.scene().reach.unwrap();
        // Every third pose, to keep the test short; the class is judged, not the pose.
        let cells: Vec<usize> = (0..grid.len()).step_by(3).collect();
        let view =
            |side, part: usize, cell: usize, seed| image(&simulator, &background, part, side, &grid.pose(cell), seed);
        let pegs: Vec<(usize, TactileImage)> = (0..12)
            .flat_map(|part| cells.iter().map(move |cell| (part, *cell)))
            .map(|(part, cell)| (part, view(Side::Peg, part, cell, 11 + cell as u64)))
            .collect();
        let (mut right, mut right_flipped, mut correlation) = (0, 0, 0.0);
        let n_holes = 96;
        for i in 0..n_holes {
            let (part, cell) = (i % 12, cells[(i * 7) % cells.len()]);
            let hole = view(Side::Hole, part, cell, 1_000 + i as u64);
            let nearest = |sign: f32| {
                let distance = |peg: &TactileImage| {
                    peg.planes.iter().zip(&hole.planes).map(|(p, h)| (h - sign * p).abs()).sum::<f32>()
                };
                pegs.iter().min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1))).unwrap().0
            };
            right += usize::from(nearest(1.0) == part);
            right_flipped += usize::from(nearest(-1.0) == part);
            let peg = view(Side::Peg, part, cell, 500 + i as u64);
            let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| f64::from(x * y)).sum::<f64>();
            correlation += product(&hole.planes, &peg.planes)
                / (product(&hole.planes, &hole.planes) * product(&peg.planes, &peg.planes)).sqrt()
                / n_holes as f64;
        }
        let most = n_holes * 15 / 100;
        assert!(right <= most && right_flipped <= most, "Pixel {right}, flipped {right_flipped} of {n_holes}");
        assert!(correlation < 0.0, "mean hole-peg correlation {correlation}");
    }
}
