//! The pairs of a dataset, and what is computed from them once before training.

use rayon::prelude::*;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::moved_view::moved_view;
use tactile_data::frame::{Background, Frame, Preprocessing, TactileImage};
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_infer::calibration::BLANK_SHARE;

use crate::config::{Flips, TrainConfig};
use crate::error::{Error, Result};
use crate::mating::{Mating, Pair, Within, find};
use crate::relighting::Relighting;

/// Views from places nearer than this look alike, mm and degrees: twice what the camera's noise and the robot's
/// repeatability hide.
const ALIKE: (f64, f64) = (1.0, 5.0);

/// Most frames whose mean and variance are measured.
const STATISTICS_FRAMES: usize = 2_000;

/// Most frames in which the lamps are searched.
const LAMP_FRAMES: usize = 400;

/// Where a pair was touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The board, by its number in the order of appearance.
    pub board: usize,
    /// The sensor's pose on it; `None` where it was not recorded.
    pub pose: Option<Se2>,
    /// Whether neither view shows an edge.
    pub blank: bool,
}

impl Place {
    /// Whether two pairs are of one board, both poses known, nearer than `mm` and `deg`.
    pub fn is_within(&self, other: &Self, mm: f64, deg: f64) -> bool {
        let (Some(a), Some(b)) = (self.pose, other.pose) else { return false };
        let turned = wrap_angle(a.theta_rad - b.theta_rad).to_degrees().abs();
        self.board == other.board && a.distance_mm(&b) < mm && turned < deg
    }
}

impl Pairs<'_> {
    /// A frame of a pair: the peg's as it would be seen from where the hole was touched.
    pub(crate) fn frame(&self, pair: &Pair, side: Side) -> Frame {
        let frame = self.dataset.frame(if side == Side::Hole { pair.hole } else { pair.peg });
        match pair.sensor_from_hole.filter(|_| side == Side::Peg) {
            Some(moved) => moved_view(self.dataset.no_contact(), &frame, &moved, self.dataset.meta().mm_per_px),
            None => frame,
        }
    }
}

/// The pairs of a dataset, split by board, and the statistics of its training frames.
#[derive(Debug)]
pub struct Pairs<'a> {
    pub(crate) dataset: &'a Dataset,
    pub(crate) background: Background,
    /// Preprocessing for the network: input size, mean and standard deviation of the training frames.
    pub preprocessing: Preprocessing,
    /// Pairs of the training boards.
    pub training: Vec<Pair>,
    /// Where each pair of the training boards was touched.
    pub places: Vec<Place>,
    /// Pairs of the held-out boards, board by board.
    pub held_out: Vec<Vec<Pair>>,
    pub(crate) neighbours: Vec<Vec<u32>>,
    pub(crate) relighting: Option<Relighting>,
    /// How the pairs were found, and what did not mate: [`Mating::notes`].
    pub notes: Vec<String>,
    /// A warning about these pairs, for people.
    pub warning: Option<String>,
}

impl<'a> Pairs<'a> {
    /// Finds the pairs ([`find`]). Measures mean and variance over at most 2,000 training frames, finds the blank views, and
    /// the lamps for relit flips.
    ///
    /// # Errors
    /// No pairs, or pairs from which nothing can be learned: all blank, or all of one place.
    pub fn new(dataset: &'a Dataset, config: &TrainConfig) -> Result<Self> {
        let input_px = config.network.input_px;
        let Mating { training, held_out, notes } = find(dataset, config.mating());
        let name = &dataset.meta().name;
        if training.is_empty() {
            let mut why = notes.iter().map(|note| format!("; {note}")).collect::<String>();
            let is_there = |side| dataset.touches().iter().any(|touch| touch.side == Some(side));
            for side in [Side::Hole, Side::Peg].into_iter().filter(|side| !is_there(*side)) {
                why += &format!("; none is of a {side} (tactile-data generate --sides both touches both)");
            }
            return Err(Error::invalid(
                name,
                "mating pairs of hole and peg frames to train on",
                format!("0 pairs{why}"),
            ));
        }
        let frame_px = dataset.meta().frame_px;
        if (0..2).any(|axis| frame_px[axis] < 2 * input_px[axis]) {
            let [width, height] = frame_px;
            let expected = format!("at most half of the {width}x{height} pixels of {name}'s frames (see --frame-px)");
            return Err(Error::invalid("input_px", expected, format!("{}x{}", input_px[0], input_px[1])));
        }
        let preprocessing = measure(dataset, &training, input_px)?;
        // Decoded at twice the input size, so that a crop has at least as many pixels as the input.
        let wide = Preprocessing { input_px: input_px.map(|n| 2 * n), ..preprocessing.clone() };
        let unusable = |e: tactile_data::Error| Error::invalid(name, "frames to train on", e.to_string());
        let background = dataset.background(&wide).map_err(unusable)?;
        let places = places(dataset, &background, &training)?;
        check_worth(name, &places)?;
        let neighbours = neighbours(&places);
        let lamps = || fit_lamps(dataset, &training, &preprocessing);
        let (relighting, warning) = match config.flips {
            Flips::Relit => (Some(lamps()?), None),
            Flips::Plain | Flips::None => (None, None),
            Flips::Auto => match lamps() {
                Ok(relighting) => (Some(relighting), None),
                Err(why) => (None, Some(format!("mirrored pictures are not relit, {why}"))),
            },
        };
        Ok(Self {
            dataset,
            background,
            preprocessing,
            training,
            places,
            held_out,
            neighbours,
            relighting,
            notes,
            warning,
        })
    }
}

/// Number of pairs of a dataset to train on.
pub fn n_training(dataset: &Dataset, within: Within) -> usize {
    find(dataset, within).training.len()
}

/// About `n_frames` training frames, evenly spaced, as difference images in counts.
fn sample<'a>(
    dataset: &'a Dataset,
    training: &'a [Pair],
    input_px: [usize; 2],
    n_frames: usize,
) -> Result<impl ParallelIterator<Item = Result<TactileImage>> + 'a> {
    let background = dataset.background(&Preprocessing::counts(input_px))?;
    let pairs = training.par_iter().step_by(training.len().div_ceil(n_frames / 2));
    let frames = pairs.flat_map_iter(|pair| [pair.hole, pair.peg]);
    Ok(frames.map(move |frame| Ok(background.tactile_image(&dataset.frame(frame))?)))
}

/// Mean and standard deviation of each channel over training frames, f64 sums.
fn measure(dataset: &Dataset, training: &[Pair], input_px: [usize; 2]) -> Result<Preprocessing> {
    let sums = sample(dataset, training, input_px, STATISTICS_FRAMES)?
        .map(|image| {
            let n_pixels = input_px[0] * input_px[1];
            let mut sums = [[0.0_f64; 2]; 3];
            for (sum, plane) in sums.iter_mut().zip(image?.planes.chunks_exact(n_pixels)) {
                for &value in plane {
                    sum[0] += f64::from(value) / n_pixels as f64;
                    sum[1] += f64::from(value).powi(2) / n_pixels as f64;
                }
            }
            Ok(sums)
        })
        .collect::<Result<Vec<_>>>()?;
    let mean_of =
        |channel: usize, power: usize| sums.iter().map(|sum| sum[channel][power]).sum::<f64>() / sums.len() as f64;
    let mean = [0, 1, 2].map(|channel| mean_of(channel, 0));
    let std = [0, 1, 2].map(|channel| (mean_of(channel, 1) - mean[channel].powi(2)).sqrt());
    if std.iter().any(|s| s.is_nan() || *s <= 0.1) {
        let got = format!("standard deviation {std:?} counts");
        return Err(Error::invalid(&dataset.meta().name, "frames that differ from the sensor at rest", got));
    }
    let meta = dataset.meta();
    let field_of_view_mm = meta.field_of_view_mm();
    Ok(Preprocessing { input_px, field_of_view_mm, mean: mean.map(|m| m as f32), std: std.map(|s| s as f32) })
}

/// Where each pair was touched, and whether it shows an edge.
fn places(dataset: &Dataset, background: &Background, training: &[Pair]) -> Result<Vec<Place>> {
    let mut boards: Vec<Option<&str>> = Vec::new();
    let board_of: Vec<usize> = training
        .iter()
        .map(|pair| {
            let part = dataset.touch(pair.peg).part.as_deref();
            boards.iter().rposition(|board| *board == part).unwrap_or_else(|| {
                boards.push(part);
                boards.len() - 1
            })
        })
        .collect();
    let is_blank = |frame: usize| -> Result<bool> {
        Ok(background.tactile_image(&dataset.frame(frame))?.edge_share < BLANK_SHARE)
    };
    training
        .par_iter()
        .zip(board_of)
        .map(|(pair, board)| {
            let blank = is_blank(pair.hole)? && is_blank(pair.peg)?;
            Ok(Place { board, pose: dataset.touch(pair.peg).part_from_sensor, blank })
        })
        .collect()
}

/// Refuses pairs that all look the same.
fn check_worth(name: &str, places: &[Place]) -> Result<()> {
    let n = places.len();
    if places.iter().all(|place| place.blank) {
        let got = format!("{n} blank pairs: no frame differs from the sensor at rest by an edge");
        return Err(Error::invalid(name, "pairs that show an edge", got));
    }
    let first = &places[0];
    if n > 1 && places.iter().all(|place| first.is_within(place, ALIKE.0, ALIKE.1)) {
        let got = format!("{n} pairs within {} mm and {} degrees of each other", ALIKE.0, ALIKE.1);
        return Err(Error::invalid(name, "pairs of different places", got));
    }
    Ok(())
}

/// For each training pair, others on the same board 1 to 8 mm away and at most 40 degrees turned.
fn neighbours(places: &[Place]) -> Vec<Vec<u32>> {
    let is_near = |a: &Place, b: &Place| a.is_within(b, 8.0, 40.0) && is_apart(a, b);
    places
        .par_iter()
        .map(|place| {
            places.iter().enumerate().filter(|(_, other)| is_near(place, other)).map(|(i, _)| i as u32).collect()
        })
        .collect()
}

/// More than 1 mm or 10 degrees apart.
fn is_apart(a: &Place, b: &Place) -> bool {
    let (Some(a), Some(b)) = (a.pose, b.pose) else { return false };
    a.distance_mm(&b) > 1.0 || wrap_angle(b.theta_rad - a.theta_rad).to_degrees().abs() > 10.0
}

/// The lamps, found in evenly spaced training frames.
fn fit_lamps(dataset: &Dataset, training: &[Pair], preprocessing: &Preprocessing) -> Result<Relighting> {
    let input_px = preprocessing.input_px;
    let images: Vec<_> = sample(dataset, training, input_px, LAMP_FRAMES)?.collect::<Result<_>>()?;
    let mm_per_px = [0, 1].map(|axis| preprocessing.field_of_view_mm[axis] / input_px[axis] as f64);
    Relighting::fit(&images, mm_per_px, preprocessing)
}
