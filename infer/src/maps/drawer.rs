//! The trained network on the CPU without tensors, as [`crate::embedding::encoder`] is: normalisations folded into the weights, the weights
//! packed once.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::{OUTLINE_REACH_MM, Side};
use tactile_data::frame::{Preprocessing, TactileImage};

use super::{Drawn, LOG_ERRORS, MapConfig, MapFile, N_DRAWN, N_SEEN, StageLayers, side_value};
use crate::embedding::encoder::{Dense, Layer, Tensors, pixel_by_pixel};
use crate::error::{Error, Result};

/// Draws maps of touches.
#[derive(Clone, Debug)]
pub struct MapDrawer {
    config: MapConfig,
    preprocessing: Preprocessing,
    down: Vec<[Layer; 2]>,
    up: Vec<[Layer; 2]>,
    draw: Dense,
}

/// A map that was drawn, `[height, width]` each, rows from the top.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrawnMap {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// Width and height of the view, mm.
    pub view_mm: [f64; 2],
    /// The distance to the outline of the peg, mm, negative inside.
    pub distance_mm: Vec<f32>,
    /// The mean error that is expected of it, mm.
    pub error_mm: Vec<f32>,
    /// The probability that a place is inside the outline, 0..=1.
    pub inside: Vec<f32>,
    /// The probability that it touches the gel, 0..=1.
    pub contact: Vec<f32>,
}

impl MapDrawer {
    /// Folds the tensors of a file.
    ///
    /// # Errors
    /// A tensor that is missing or of another size, values that are not finite, and variances below zero.
    pub fn new(file: &MapFile) -> Result<Self> {
        let MapFile { config, tensors, preprocessing, .. } = file;
        let tensors = Tensors::of(tensors);
        let [width, height] = config.input_px;
        let mut size = [height, width];
        let stage = |name: &str, layers: &StageLayers, size: [usize; 2]| -> Result<[Layer; 2]> {
            let change = Layer::new(&tensors, &format!("{name}.change"), &layers.change, size)?;
            let refine = Layer::new(&tensors, &format!("{name}.refine"), &layers.refine, change.out_size().0)?;
            Ok([change, refine])
        };
        let [of_down, of_up] = config.stages();
        let (mut down, mut sizes) = (Vec::new(), Vec::new());
        for (at, layers) in of_down.iter().enumerate() {
            down.push(stage(&format!("down.{at}"), layers, size)?);
            size = down[at][1].out_size().0;
            sizes.push(size);
        }
        sizes.pop();
        let up = of_up.iter().zip(sizes.iter().rev()).enumerate();
        let up = up.map(|(at, (layers, size))| stage(&format!("up.{at}"), layers, *size)).collect::<Result<_>>()?;
        let draw = Dense::new(&tensors, "draw", None, [config.width, N_DRAWN], |at| at)?;
        let draw = draw.with_bias(tensors.get("draw.bias", N_DRAWN)?);
        Ok(Self { config: *config, preprocessing: preprocessing.clone(), down, up, draw })
    }

    /// Folds the tensors of the file at a path.
    ///
    /// # Errors
    /// As [`MapFile::load`] and [`Self::new`].
    pub fn load(path: &Path) -> Result<Self> {
        Self::new(&MapFile::load(path)?).map_err(|error| error.within(path.display()))
    }

    /// The sizes of the network.
    pub fn config(&self) -> &MapConfig {
        &self.config
    }

    /// How frames become its pictures.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// Width and height of what the pictures showed that the network learnt from, mm.
    pub fn view_mm(&self) -> [f64; 2] {
        self.preprocessing.field_of_view_mm
    }

    /// Draws what touches of a side show, by pictures of so much, mm.
    ///
    /// # Errors
    /// A picture of another size than the network's.
    pub fn draw(&self, images: &[TactileImage], side: Side, view_mm: [f64; 2]) -> Result<Vec<DrawnMap>> {
        let [width, height] = self.config.input_px;
        let mut seen = Vec::with_capacity(images.len() * N_SEEN * width * height);
        for image in images {
            if image.size_px != self.config.input_px {
                let got = format!("{:?}", image.size_px);
                return Err(Error::invalid("picture", format!("{:?} pixels", self.config.input_px), got));
            }
            seen.extend_from_slice(&image.planes);
            seen.resize(seen.len() + width * height, side_value(side));
        }
        let drawn = self.forward(&pixel_by_pixel::<N_SEEN>(&seen, [height, width]));
        let of = |values| DrawnMap::of(self.config.input_px, self.view_mm(), values).of_view(view_mm);
        Ok(drawn.chunks_exact(N_DRAWN * width * height).map(of).collect())
    }

    /// `[n, height, width, N_SEEN]` -> `[n, height, width, N_DRAWN]`.
    fn forward(&self, images: &[f32]) -> Vec<f32> {
        let stage = |[change, refine]: &[Layer; 2], x: &[f32]| refine.forward(&change.forward(x));
        let mut seen: Vec<Vec<f32>> = Vec::with_capacity(self.down.len());
        for layers in &self.down {
            seen.push(stage(layers, seen.last().map_or(images, Vec::as_slice)));
        }
        let mut x = seen.pop().unwrap_or_default();
        let mut below = self.down.last();
        for layers in &self.up {
            // As many sizes up as down.
            let (Some(before), Some([_, last])) = (seen.pop(), below) else { break };
            let (size, n_below) = last.out_size();
            let (full, n_here) = layers[1].out_size();
            x = stage(layers, &joined((&x, size, n_below), (&before, full, n_here)));
            below = Some(layers);
        }
        self.draw.forward(&x)
    }
}

/// Values by pixel, the height and width of their images, and the channels of a pixel.
type Pixels<'a> = (&'a [f32], [usize; 2], usize);

/// Each pixel of the smaller images as two by two, cut to the size of the larger ones, with their channels after it.
fn joined((small, [rows, columns], n_small): Pixels<'_>, (large, [height, width], n_large): Pixels<'_>) -> Vec<f32> {
    let n_images = large.len() / (height * width * n_large);
    let mut out = Vec::with_capacity(n_images * height * width * (n_small + n_large));
    for at in 0..n_images * height * width {
        let (image, row, column) = (at / (height * width), at / width % height, at % width);
        let below = (image * rows + row / 2) * columns + column / 2;
        out.extend_from_slice(&small[below * n_small..][..n_small]);
        out.extend_from_slice(&large[at * n_large..][..n_large]);
    }
    out
}

impl DrawnMap {
    /// Refuses what no network draws: other numbers of values than pixels, values that are not finite, errors that are not positive.
    ///
    /// # Errors
    /// The map.
    pub fn validate(&self) -> Result<()> {
        let Self { size_px: [width, height], view_mm, distance_mm, error_mm, inside, contact } = self;
        let n = width.saturating_mul(*height);
        let all = [distance_mm, error_mm, inside, contact];
        let is_view = view_mm.iter().all(|mm| mm.is_finite() && *mm > 0.0);
        let is_whole = *width > 1 && *height > 1 && all.iter().all(|values| values.len() == n);
        let are_good = all.iter().flat_map(|values| values.iter()).all(|value| value.is_finite())
            && error_mm.iter().all(|error| *error > 0.0);
        if is_view && is_whole && are_good {
            return Ok(());
        }
        let expected = "four finite values a pixel, each error above 0, of a view with a size";
        Err(Error::invalid("map of a touch", expected, format!("{width} x {height} pixels of {view_mm:?} mm")))
    }

    /// The middle of a pixel about the middle of the view, mm; `at` counts by rows.
    pub fn place_mm(&self, at: usize) -> [f64; 2] {
        [self.along(0, at % self.size_px[0]), self.along(1, at / self.size_px[0])]
    }

    /// Each so many pixels along both axes, by rows: which one it is, and its [`Self::place_mm`].
    pub fn places_mm(&self, every: usize) -> impl Iterator<Item = (usize, [f64; 2])> {
        let [width, height] = self.size_px;
        let xs: Vec<(usize, f64)> = (0..width).step_by(every).map(|column| (column, self.along(0, column))).collect();
        let of_row = move |row: usize| {
            let y = self.along(1, row);
            xs.iter().map(|(column, x)| (row * width + column, [*x, y])).collect::<Vec<_>>()
        };
        (0..height).step_by(every).flat_map(of_row)
    }

    /// The middle of a pixel along an axis, mm.
    fn along(&self, axis: usize, pixel: usize) -> f64 {
        ((pixel as f64 + 0.5) / self.size_px[axis] as f64 - 0.5) * self.view_mm[axis]
    }

    /// The same where the pictures show so much, mm: the network measures in pixels, so that distances grow with the view.
    #[must_use]
    pub fn of_view(mut self, view_mm: [f64; 2]) -> Self {
        let is_other = |axis: usize| (view_mm[axis] / self.view_mm[axis] - 1.0).abs() > 1e-9;
        if is_other(0) || is_other(1) {
            let area = |[width, height]: [f64; 2]| width * height;
            let ratio = (area(view_mm) / area(self.view_mm)).sqrt() as f32;
            let reach = OUTLINE_REACH_MM as f32;
            self.distance_mm.iter_mut().for_each(|mm| *mm = (*mm * ratio).clamp(-reach, reach));
            self.error_mm.iter_mut().for_each(|mm| *mm *= ratio);
            self.view_mm = view_mm;
        }
        self
    }

    fn of(size_px: [usize; 2], view_mm: [f64; 2], values: &[f32]) -> Self {
        let of = |what: Drawn, value: &dyn Fn(f32) -> f32| {
            values.chunks_exact(N_DRAWN).map(|place| value(place[what as usize])).collect::<Vec<f32>>()
        };
        let probability = |odds: f32| (1.0 + (-odds).exp()).recip();
        Self {
            size_px,
            view_mm,
            distance_mm: of(Drawn::Distance, &|mm| mm),
            error_mm: of(Drawn::LogError, &|log| log.clamp(LOG_ERRORS[0], LOG_ERRORS[1]).exp()),
            inside: of(Drawn::Inside, &probability),
            contact: of(Drawn::Contact, &probability),
        }
    }
}

#[cfg(all(test, feature = "burn"))]
mod tests {
    use burn::tensor::{Tensor, TensorData};

    use super::*;
    use crate::embedding::device::DeviceKind;
    use crate::embedding::network::{tensors_of, with_tensors};
    use crate::maps::MapProvenance;

    const VIEW_MM: [f64; 2] = [18.6, 14.3];

    /// A file of a network with statistics that are not those of a fresh one, of sizes that halve unevenly.
    fn file() -> MapFile {
        let config = MapConfig { input_px: [21, 18], width: 5 };
        let mut tensors = tensors_of(&config.init(3, &DeviceKind::Flex.tensor_device()));
        for tensor in tensors.iter_mut().filter(|t| t.shape.len() == 1) {
            let is_variance = tensor.name.ends_with("var");
            for (i, value) in tensor.values.iter_mut().enumerate() {
                *value = if is_variance { 0.5 + 0.1 * i as f32 } else { (i as f32 + tensor.name.len() as f32).sin() };
            }
        }
        let preprocessing = Preprocessing::counts(config.input_px);
        let provenance = MapProvenance { steps: 7, ..Default::default() };
        MapFile { config, preprocessing, provenance, verifier: None, presence: [None; 3], tensors }
    }

    fn images(n: usize) -> Vec<TactileImage> {
        let plane = |image: usize| (0..3 * 21 * 18).map(move |i| ((i + 91 * image) as f32 * 0.7).sin()).collect();
        (0..n).map(|image| TactileImage { size_px: [21, 18], planes: plane(image), edge_share: 0.1 }).collect()
    }

    #[test]
    fn a_map_is_the_burn_networks_but_for_rounding() {
        let (file, device, images) = (file(), DeviceKind::Flex.tensor_device(), images(3));
        let network = with_tensors(file.config.init(4, &device), file.tensors.clone()).unwrap();
        for side in [Side::Hole, Side::Peg] {
            let seen = images.iter().flat_map(|image| image.planes.iter().copied().chain([side_value(side); 21 * 18]));
            let seen = Tensor::from_data(TensorData::new(seen.collect::<Vec<f32>>(), [3, N_SEEN, 18, 21]), &device);
            let expected = network.forward(seen).into_data().try_into_vec::<f32>().unwrap();
            let largest = expected.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            let found = MapDrawer::new(&file).unwrap().draw(&images, side, VIEW_MM).unwrap();
            assert_eq!((found.len(), found[1].contact.len()), (3, 21 * 18));
            for (at, expected) in expected.chunks_exact(N_DRAWN).enumerate() {
                let (map, place) = (&found[at / (21 * 18)], at % (21 * 18));
                let odds = |probability: f32| (probability / (1.0 - probability)).ln();
                // Sums of some hundred products in fourteen layers, each rounded to 6e-8 of the largest.
                let tolerance = 1e-4 * largest;
                assert!((map.distance_mm[place] - expected[0]).abs() < tolerance, "{place}");
                let log_error = expected[1].clamp(LOG_ERRORS[0], LOG_ERRORS[1]);
                assert!((map.error_mm[place].ln() - log_error).abs() < tolerance, "{place}");
                // A probability near 1 is rounded to 6e-8.
                for (found, expected) in [(map.inside[place], expected[2]), (map.contact[place], expected[3])] {
                    let rounded = 1e-7 * (1.0 + expected.abs().exp());
                    assert!(expected.abs() > 10.0 || (odds(found) - expected).abs() < tolerance + rounded, "{place}");
                }
            }
        }
    }

    #[test]
    fn a_file_comes_back_in_f16_and_what_does_not_fit_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("maps.safetensors");
        let file = file();
        file.save(&path).unwrap();
        let loaded = MapFile::load(&path).unwrap();
        assert_eq!(
            (loaded.config, &loaded.preprocessing, &loaded.provenance),
            (file.config, &file.preprocessing, &file.provenance)
        );
        loaded.save(&path).unwrap();
        assert_eq!(MapFile::load(&path).unwrap(), loaded);
        let [exact, rounded] =
            [&file, &loaded].map(|of| MapDrawer::new(of).unwrap().draw(&images(1), Side::Hole, VIEW_MM).unwrap());
        let off =
            exact[0].distance_mm.iter().zip(&rounded[0].distance_mm).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let largest = exact[0].distance_mm.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        assert!(off > 0.0 && off < 0.01 * largest, "{off} {largest}");

        let mut lacking = loaded.clone();
        lacking.tensors.retain(|tensor| tensor.name != "up.1.refine.norm.beta");
        assert!(MapDrawer::new(&lacking).unwrap_err().to_string().contains("up.1.refine.norm.beta"));
        let mut odd = loaded;
        odd.preprocessing.input_px = [20, 18];
        odd.save(&path).unwrap();
        assert!(MapFile::load(&path).unwrap_err().to_string().contains("preprocessing.input_px"));
        let other = TactileImage { size_px: [40, 30], planes: vec![0.0; 3_600], edge_share: 0.0 };
        assert!(
            MapDrawer::new(&file)
                .unwrap()
                .draw(&[other], Side::Peg, VIEW_MM)
                .unwrap_err()
                .to_string()
                .contains("[21, 18] pixels")
        );
    }
}
