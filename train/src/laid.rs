//! A touch that is laid on a view of a part, as the network that judges sees it: on a map that may end, and that of a look-alike only
//! where the touch shows that it differs.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_infer::maps::DrawnMap;
use tactile_infer::maps::mosaic::Mosaic;
use tactile_infer::maps::verifier::{N_COMPARED, OF_PART, compared};

/// A look-alike is none where a touch does not show that it differs: by more than so far on so much of it, mm and mm2.
const DIFFERS: (f64, f64) = (0.6, 3.0);

/// Every second touch is laid on a map that ends within its view, so far from its middle, mm, or before it: what a bank's map does not show
/// says nothing.
const END_MM: [f64; 2] = [-11.0, 10.0];

/// A touch laid on a view.
#[derive(Clone, Copy, Debug)]
pub struct Laid {
    /// Whose map.
    pub part: usize,
    /// Where.
    pub part_from_sensor: Se2,
    /// Whether the touch was made on that part.
    pub is_own: bool,
    /// Cosine of the embeddings before it was aligned.
    pub cosine: f32,
    /// What of the touch the part's map is taken to end at.
    pub end: Option<End>,
}

/// A line across a touch beyond which a map shows nothing: its direction from the middle and how far that is, mm.
#[derive(Clone, Copy, Debug)]
pub struct End {
    towards: [f64; 2],
    at_mm: f64,
}

impl End {
    /// One that every second touch has.
    pub fn drawn(rng: &mut ChaCha8Rng) -> Option<Self> {
        let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
        let end = Self { towards: [cos, sin], at_mm: rng.random_range(END_MM[0]..END_MM[1]) };
        rng.random_bool(0.5).then_some(end)
    }

    fn hides(&self, [x, y]: [f64; 2]) -> bool {
        self.towards[0] * x + self.towards[1] * y > self.at_mm
    }
}

impl Laid {
    /// Whether the part's map goes as far as a place of the touch, mm.
    fn shows(&self, place_mm: [f64; 2]) -> bool {
        !self.end.is_some_and(|end| end.hides(place_mm))
    }

    /// What is compared there ([`compared`]), as far as the part's map goes.
    pub fn compared(&self, (map, side): (&DrawnMap, Side), mosaic: &Mosaic<'_>) -> Vec<f32> {
        let mut places = compared((map, side), mosaic, &self.part_from_sensor);
        for (at, place) in places.chunks_exact_mut(N_COMPARED).enumerate() {
            if !self.shows(map.place_mm(at)) {
                place[OF_PART].fill(0.0);
            }
        }
        places
    }

    /// Whether the touch shows that a map laid here differs from the one of its own part at its own pose.
    pub fn differs(&self, map: &DrawnMap, (mosaic, own): (&Mosaic<'_>, &Mosaic<'_>), own_pose: &Se2) -> bool {
        let [width, height] = map.size_px;
        let is_other = |at: &usize| {
            let place = map.place_mm(*at);
            let here = mosaic.at(self.part_from_sensor.apply(place)).zip(own.at(own_pose.apply(place)));
            self.shows(place) && here.is_some_and(|(a, b)| f64::from((a.distance_mm - b.distance_mm).abs()) > DIFFERS.0)
        };
        let place_mm2 = map.view_mm[0] * map.view_mm[1] / (width * height) as f64;
        (0..width * height).filter(is_other).count() as f64 * place_mm2 > DIFFERS.1
    }
}
