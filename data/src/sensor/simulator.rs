//! The simulated sensor on a scene's parts: what a robot would see.

use std::sync::OnceLock;

use rand::rngs::ChaCha8Rng;

use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::pose::se2::Se2;
use crate::pose::symmetry::Symmetry;
use crate::scene::random::{around_zero, uniform};
use crate::scene::{MazeBoards, Parts, Scene};
use crate::sensor::camera::{Camera, LayerLines, to_frame};
use crate::sensor::exposure::Exposure;
use crate::sensor::gel::{Surface, TiltedPress};
use crate::sensor::geometry::{self, ContactMask};
use crate::sensor::optics::Optics;
use crate::sensor::{Fidelity, SensorSpec};

pub use crate::scene::random::frame_rng;

/// Exposures averaged into the no-contact frame, as one would take it on a bench.
const REST_EXPOSURES: u64 = 8;

/// A scene that can be touched. What a part's side needs is computed when it is first touched, and kept.
#[derive(Debug)]
pub struct Simulator {
    scene: Scene,
    parts: Vec<String>,
    board_seed: u64,
    camera: Camera,
    optics: Optics,
    sides: Vec<[OnceLock<Result<Touchable>>; 2]>,
    symmetries: Vec<OnceLock<Symmetry>>,
    /// The sensors over the holes and over the pegs of each MAZE board.
    sensors: Vec<[OnceLock<BoardSensor>; 2]>,
}

/// A sensor drawn for one side of a board.
#[derive(Debug)]
struct BoardSensor {
    spec: SensorSpec,
    optics: Optics,
    camera: Camera,
}

/// The parts of a scene, printed: prints have the same shapes, each with layer lines of its own.
#[derive(Clone, Copy, Debug)]
pub struct Print<'a> {
    simulator: &'a Simulator,
    seed: u64,
    slopes: [f64; 2],
}

/// One side of one part, as far as the scene's fidelity needs it.
#[derive(Debug)]
enum Touchable {
    Mask(ContactMask),
    Surface(Surface),
}

impl Simulator {
    /// Prepares a scene; `board_seed` draws its MAZE boards.
    pub fn new(scene: Scene, board_seed: u64) -> Result<Self> {
        scene.validate()?;
        let parts = scene.part_names();
        Ok(Self {
            camera: Camera::new(&scene.sensor),
            optics: Optics::new(&scene.sensor),
            sides: parts.iter().map(|_| Default::default()).collect(),
            symmetries: parts.iter().map(|_| OnceLock::new()).collect(),
            sensors: parts.iter().map(|_| Default::default()).collect(),
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

    /// What draws the boards.
    pub fn board_seed(&self) -> u64 {
        self.board_seed
    }

    /// The sensor that feels one side of a part: the scene's own, or what was drawn for a MAZE board.
    ///
    /// # Panics
    /// Where there is no such part.
    pub fn sensor_of(&self, part: usize, side: Side) -> &SensorSpec {
        self.sensor(part, side).0
    }

    /// The turns after which a part's peg looks the same: its pose is then known only up to them.
    pub fn symmetry(&self, part: usize) -> Symmetry {
        let peg = || self.scene.reliefs(part, Side::Peg, self.board_seed).ok()?.into_iter().next();
        let look = || peg().map_or(Symmetry::NONE, |peg| peg.symmetry());
        self.symmetries.get(part).map_or(Symmetry::NONE, |known| *known.get_or_init(look))
    }

    /// The sensor at rest: the mean of a few exposures.
    pub fn no_contact(&self, seed: u64) -> Frame {
        let size_px = self.scene.sensor.frame_px;
        if self.scene.fidelity == Fidelity::Geometry {
            return geometry::at_rest(size_px);
        }
        let exposure = self.exposure(&self.optics, &self.camera, &self.scene.sensor);
        if self.scene.fidelity < Fidelity::Camera {
            return exposure.at_rest(&mut frame_rng(seed, 0));
        }
        let mut mean = vec![0.0_f32; 3 * size_px[0] * size_px[1]];
        for stream in 0..REST_EXPOSURES {
            let frame = exposure.at_rest(&mut frame_rng(seed, stream));
            mean.iter_mut().zip(frame.rgb()).for_each(|(m, v)| *m += f32::from(*v) / REST_EXPOSURES as f32);
        }
        to_frame(&mean, size_px)
    }

    /// Computes what a touch of one side of a part needs, where that is not done yet. A touch does so by
    /// itself; several sides can be prepared at once.
    pub fn prepare(&self, part: usize, side: Side) -> Result<()> {
        self.side(part, side).map(|_| ())
    }

    /// Presses the sensor onto one side of a part of the first print: [`Print::touch`].
    ///
    /// # Errors
    /// As [`Print::touch`].
    pub fn touch(&self, part: usize, side: Side, part_from_sensor: &Se2, rng: &mut ChaCha8Rng) -> Result<Frame> {
        self.print(0).touch(part, side, part_from_sensor, rng)
    }

    /// A print of the parts. The first, 0, is drawn from the board's seed; no print depends on how many there are.
    pub fn print(&self, index: usize) -> Print<'_> {
        // Far from the small seeds of datasets and banks, whose first prints these would else be.
        Print { simulator: self, seed: self.board_seed ^ ((index as u64) << 32), slopes: [0.0; 2] }
    }

    /// Whether one print differs from another: its layer lines are simulated.
    pub fn prints_differ(&self) -> bool {
        self.scene.fidelity >= Fidelity::Camera && self.scene.sensor.texture_mm[1] > 0.0
    }

    /// How deep the gel is pressed in over one side of a part, `[height + 2, width + 2]` pixels of the sensor's frame with a margin of one, mm,
    /// by a press of a depth: without what differs from touch to touch.
    pub(crate) fn depths(
        &self,
        (part, side): (usize, Side),
        part_from_sensor: &Se2,
        depth_mm: f64,
    ) -> Result<Vec<f32>> {
        let (spec, ..) = self.sensor(part, side);
        match self.side(part, side)? {
            Touchable::Surface(surface) => {
                let press = TiltedPress::level(depth_mm);
                Ok(surface.depths(part_from_sensor, spec.frame_px, spec.mm_per_px(), press))
            }
            Touchable::Mask(_) => Err(Error::invalid("scene.fidelity", "one with a gel", "geometry alone")),
        }
    }

    fn exposure<'a>(&self, optics: &'a Optics, camera: &'a Camera, spec: &SensorSpec) -> Exposure<'a> {
        Exposure { fidelity: self.scene.fidelity, optics, camera, mm_per_px: spec.mm_per_px() }
    }

    fn side(&self, part: usize, side: Side) -> Result<&Touchable> {
        let Some(sides) = self.sides.get(part) else {
            return Err(Error::invalid("part", format!("one of {} parts", self.parts.len()), part.to_string()));
        };
        let prepared = sides[index_of(side)].get_or_init(|| {
            let (spec, ..) = self.sensor(part, side);
            let reliefs = self.scene.reliefs(part, side, self.board_seed)?;
            let half_mm = self.scene.half_extent_mm();
            if self.scene.fidelity == Fidelity::Geometry {
                return ContactMask::new(&reliefs, side, half_mm, spec.depth_mm).map(Touchable::Mask);
            }
            // What jitter and a tilt make of the press at the frame's corners.
            let tilt = spec.tilt_jitter_deg.to_radians().tan();
            let most_mm = spec.depth_jitter_mm + 0.5 * tilt * (spec.field_of_view_mm[0] + spec.field_of_view_mm[1]);
            let depths_mm = [(spec.depth_mm - most_mm).max(0.0), spec.depth_mm, spec.depth_mm + most_mm];
            Surface::solve(&reliefs, side, half_mm, Some(spec.gel_length_mm), depths_mm).map(Touchable::Surface)
        });
        prepared.as_ref().map_err(|e| Error::invalid(&self.parts[part], "a part that can be pressed", e.to_string()))
    }

    /// The sensor over one side of a part: the scene's own, or what was drawn for a MAZE board.
    fn sensor(&self, part: usize, side: Side) -> (&SensorSpec, &Optics, &Camera) {
        let Parts::Maze(boards) = &self.scene.parts else {
            return (&self.scene.sensor, &self.optics, &self.camera);
        };
        let BoardSensor { spec, optics, camera } = self.sensors[part][index_of(side)].get_or_init(|| {
            let spec = self.drawn(boards, part, side);
            BoardSensor { optics: Optics::new(&spec), camera: self.camera.varied(&spec), spec }
        });
        (spec, optics, camera)
    }

    /// The sensor of one side of a MAZE board, drawn round the scene's own, since another gel and other lamps are what a
    /// trained model meets.
    fn drawn(&self, boards: &MazeBoards, part: usize, side: Side) -> SensorSpec {
        let rng = |first: u64| frame_rng(self.board_seed, first - part as u64);
        let of_pegs = boards.draw_sensor(&self.scene.sensor, &mut rng(u64::MAX));
        match boards.sensors.and_then(|sensors| sensors.hole_scale) {
            Some(scale) if side == Side::Hole => {
                let mut rng = rng(u64::MAX / 2);
                let of_holes = boards.draw_sensor(&self.scene.sensor, &mut rng);
                let scale = uniform(&mut rng, scale);
                SensorSpec { field_of_view_mm: of_pegs.field_of_view_mm.map(|mm| scale * mm), ..of_holes }
            }
            _ => of_pegs,
        }
    }
}

impl Print<'_> {
    /// The same, each part tilted against the tool: by so much it rises towards the sensor along its x and along its y, mm a mm. Where a
    /// scene's fidelity is geometry alone, a tilt leaves in contact what is.
    #[must_use]
    pub fn tilted(self, slopes: [f64; 2]) -> Self {
        Self { slopes, ..self }
    }

    /// Presses the sensor onto one side of a part. Depth, tilt, place, texture, gain and noise are drawn
    /// from `rng`, so that two touches at one pose differ as real ones do.
    ///
    /// # Errors
    /// No such part, a part that cannot be pressed, or a pose that is not finite.
    pub fn touch(&self, part: usize, side: Side, part_from_sensor: &Se2, rng: &mut ChaCha8Rng) -> Result<Frame> {
        let simulator = self.simulator;
        let touchable = simulator.side(part, side)?;
        let (spec, optics, camera) = simulator.sensor(part, side);
        if !part_from_sensor.is_finite() {
            return Err(Error::invalid("touch", "a finite pose", format!("{part_from_sensor:?}")));
        }
        let mut jitter = |half| around_zero(rng, half);
        let pose = *part_from_sensor * Se2::new(jitter(spec.place_jitter_mm), jitter(spec.place_jitter_mm), 0.0);
        let surface = match touchable {
            Touchable::Mask(mask) => return Ok(mask.view(&pose, spec.frame_px, spec.mm_per_px())),
            Touchable::Surface(surface) => surface,
        };
        let depth_mm = (spec.depth_mm + jitter(spec.depth_jitter_mm)).max(0.0);
        let part_tilt = Se2::new(0.0, 0.0, -part_from_sensor.theta_rad).apply(self.slopes);
        let tilt = [0, 1].map(|axis| jitter(spec.tilt_jitter_deg).to_radians().tan() + part_tilt[axis]);
        let press = TiltedPress { depth_mm, tilt };
        let mut depths = surface.depths(&pose, spec.frame_px, spec.mm_per_px(), press);
        if simulator.scene.fidelity >= Fidelity::Camera {
            // Peg and hole are printed separately, each with its own lines.
            let printed = 2 * part as u64 + u64::from(side == Side::Peg);
            let lines = LayerLines::draw(&mut frame_rng(self.seed ^ 0x6c69_6e65, printed));
            lines.seen(spec, part_from_sensor.theta_rad, rng).raise(&mut depths, spec, press);
        }
        Ok(simulator.exposure(optics, camera, spec).frame(&depths, rng))
    }
}

/// Holes first.
fn index_of(side: Side) -> usize {
    usize::from(side == Side::Peg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Background, Preprocessing, TactileImage};
    use crate::scene::{Kit, SensorRange};

    fn simulator(name: &str) -> Simulator {
        Simulator::new(Scene::preset(name).unwrap(), 1).unwrap()
    }

    /// What is seen of a touch, drawn from `seed` on the part's own stream.
    fn image(
        simulator: &Simulator,
        rest: &Background,
        (part, side): (usize, Side),
        pose: &Se2,
        seed: u64,
    ) -> TactileImage {
        let frame = simulator.touch(part, side, pose, &mut frame_rng(seed, part as u64)).unwrap();
        rest.tactile_image(&frame).unwrap()
    }

    #[test]
    fn the_same_seed_gives_the_same_frame_and_another_does_not() {
        let simulator = simulator("alphabet-small");
        let touch = |seed| simulator.touch(0, Side::Hole, &Se2::IDENTITY, &mut frame_rng(seed, 0)).unwrap();
        assert_eq!(touch(1), touch(1));
        assert_ne!(touch(1), touch(2));
    }

    /// As seen from a sensor that is turned, a plate that rises along its x rises along another axis of the picture.
    #[test]
    fn a_tilted_part_is_pressed_deeper_where_it_rises() {
        let mut scene = Scene::preset("alphabet-large").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters("I", 32.0, 40.0));
        scene.fidelity = Fidelity::Gel;
        scene.sensor.tilt_jitter_deg = 0.0;
        let simulator = Simulator::new(scene, 1).unwrap();
        // Away from the letter there is nothing but the plate.
        let touch = |slopes: [f64; 2], deg: f64| {
            let pose = Se2::from_degrees(17.0, 0.0, deg);
            let frame = simulator.print(0).tilted(slopes).touch(0, Side::Hole, &pose, &mut frame_rng(3, 0)).unwrap();
            let [width, height] = [frame.width_px(), frame.height_px()];
            let grey = |x: usize, y: usize| f64::from(frame.rgb()[3 * (y * width + x)]);
            let halves = |x: usize, y: usize| [x < width / 2, y < height / 2];
            let (mut sums, mut counts) = ([[0.0; 2]; 2], [[0.0; 2]; 2]);
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                for (axis, is_first) in halves(x, y).into_iter().enumerate() {
                    sums[axis][usize::from(is_first)] += grey(x, y);
                    counts[axis][usize::from(is_first)] += 1.0;
                }
            }
            [0, 1].map(|axis| sums[axis][0] / counts[axis][0] - sums[axis][1] / counts[axis][1])
        };
        let level = touch([0.0; 2], 0.0);
        let slope = 2.0_f64.to_radians().tan();
        let [along, across] = [touch([slope, 0.0], 0.0), touch([slope, 0.0], 90.0)];
        let changed = |found: [f64; 2]| [found[0] - level[0], found[1] - level[1]].map(f64::abs);
        assert!(changed(along)[0] > 5.0 * changed(along)[1], "{level:?} {along:?}");
        assert!(changed(across)[1] > 5.0 * changed(across)[0], "{level:?} {across:?}");
        assert_eq!(touch([0.0; 2], 30.0), level);
    }

    #[test]
    fn a_print_is_what_another_seed_prints_of_the_same_parts() {
        let [one, other] =
            [1, 1 ^ (3 << 32)].map(|seed| Simulator::new(Scene::preset("alphabet-small").unwrap(), seed));
        let (one, other) = (one.unwrap(), other.unwrap());
        let rng = || frame_rng(7, 0);
        let touch = |print: Print<'_>| print.touch(2, Side::Hole, &Se2::IDENTITY, &mut rng()).unwrap();
        assert_eq!(touch(one.print(3)), touch(other.print(0)));
        assert_ne!(touch(one.print(3)), touch(one.print(0)));
        assert_eq!(touch(one.print(0)), one.touch(2, Side::Hole, &Se2::IDENTITY, &mut rng()).unwrap());
        let mut smooth = Scene::preset("alphabet-small").unwrap();
        smooth.sensor.texture_mm = [0.0; 2];
        assert!(one.prints_differ() && !Simulator::new(smooth, 1).unwrap().prints_differ());
    }

    #[test]
    fn holes_are_felt_by_a_sensor_of_their_own_where_the_scene_says_so() {
        let sensors = |hole_scale| {
            let mut scene = Scene::preset("maze").unwrap();
            let Parts::Maze(boards) = &mut scene.parts else { panic!("maze boards") };
            (boards.n_boards, boards.n_held_out) = (3, 1);
            boards.sensors = Some(SensorRange { hole_scale, ..SensorRange::default() });
            let simulator = Simulator::new(scene, 5).unwrap();
            [0, 1, 2].map(|part| [Side::Hole, Side::Peg].map(|side| simulator.sensor(part, side).0.clone()))
        };
        let width = |spec: &SensorSpec| spec.field_of_view_mm[0];
        for ([hole, peg], [_, alone]) in sensors(Some([1.02, 1.04])).iter().zip(&sensors(None)) {
            assert!(peg == alone && hole.gel_length_mm != peg.gel_length_mm && hole.light != peg.light);
            assert!(hole.noise_counts != peg.noise_counts && hole.depth_mm != peg.depth_mm);
            assert!((1.02..1.04).contains(&(width(hole) / width(peg))), "{} {}", width(hole), width(peg));
        }
        assert!(sensors(None).iter().all(|[hole, peg]| hole == peg));
    }

    #[test]
    fn over_nothing_and_on_the_plate_the_view_is_blank() {
        let mut scene = Scene::preset("alphabet-large").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters("I", 32.0, 40.0));
        let simulator = Simulator::new(scene, 1).unwrap();
        let background = Background::new(&simulator.no_contact(3), &Preprocessing::counts([40, 30])).unwrap();
        for side in [Side::Peg, Side::Hole] {
            let beside = image(&simulator, &background, (0, side), &Se2::new(20.0, 0.0, 0.0), 5);
            assert!(beside.edge_share < 0.02, "{side:?}: {}", beside.edge_share);
            let on_edge = image(&simulator, &background, (0, side), &Se2::new(3.0, 0.0, 0.0), 5);
            assert!(on_edge.edge_share > 0.05, "{side:?}: {}", on_edge.edge_share);
        }
    }

    /// Share of 96 hole images whose nearest peg image by pixel, or by the negative of it, is of the right part;
    /// and the mean correlation of a hole's and its peg's colours at one pose.
    fn nearest_by_pixel(name: &str) -> [f64; 3] {
        let simulator = simulator(name);
        let background = Background::new(&simulator.no_contact(3), &Preprocessing::counts([40, 30])).unwrap();
        let grid = simulator.scene().reach.unwrap();
        // Every third pose, to keep the test short; the class is tested, not the pose.
        let cells: Vec<usize> = (0..grid.len()).step_by(3).collect();
        let view =
            |side, part: usize, cell: usize, seed| image(&simulator, &background, (part, side), &grid.pose(cell), seed);
        let n_parts = simulator.parts().len();
        let pegs: Vec<(usize, TactileImage)> = (0..n_parts)
            .flat_map(|part| cells.iter().map(move |cell| (part, *cell)))
            .map(|(part, cell)| (part, view(Side::Peg, part, cell, 11 + cell as u64)))
            .collect();
        let n_holes = 96;
        let mut sums = [0.0; 3];
        for i in 0..n_holes {
            let (part, cell) = (i % n_parts, cells[(i * 7) % cells.len()]);
            let hole = view(Side::Hole, part, cell, 1_000 + i as u64);
            let nearest = |sign: f32| {
                let distance = |peg: &TactileImage| {
                    peg.planes.iter().zip(&hole.planes).map(|(p, h)| (h - sign * p).abs()).sum::<f32>()
                };
                pegs.iter().min_by(|a, b| distance(&a.1).total_cmp(&distance(&b.1))).unwrap().0
            };
            let peg = view(Side::Peg, part, cell, 500 + i as u64);
            let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| f64::from(x * y)).sum::<f64>();
            sums[0] += f64::from(u8::from(nearest(1.0) == part));
            sums[1] += f64::from(u8::from(nearest(-1.0) == part));
            sums[2] += product(&hole.planes, &peg.planes)
                / (product(&hole.planes, &hole.planes) * product(&peg.planes, &peg.planes)).sqrt();
        }
        sums.map(|sum| sum / f64::from(n_holes as u32))
    }

    /// A hole image is neither its peg's nor the negative of it: nearest neighbours by pixel must fail,
    /// and the colours at one pose run against each other.
    #[test]
    fn pixels_do_not_tell_which_letter_fits() {
        let [right, right_flipped, correlation] = nearest_by_pixel("alphabet-small");
        assert!(right <= 0.15 && right_flipped <= 0.15, "Pixel {right}, flipped {right_flipped}");
        assert!(correlation < 0.0, "mean hole-peg correlation {correlation}");
    }

    /// Two shells look the same from both sides: the paper's Pixel knows 3 of its 6 connectors.
    #[test]
    fn pixels_tell_about_half_of_the_connectors() {
        let [right, ..] = nearest_by_pixel("connectors");
        assert!((0.3..=0.7).contains(&right), "Pixel {right}");
    }
}
