//! A simulated picture compared with a real one of the same press.
//!
//! Two sensors at rest never look the same, and a camera's exposure drifts, so what is compared is what the press
//! changed: each frame less its own sensor's frame at rest, once its exposure is brought to that frame's on
//! pixels more than 4 mm from contact. Figures are of the contact and its coloured band alone. Similarity over
//! whole frames (SSIM and its like) is left out on purpose: the bare background scores 0.94 to 0.96 there.

pub mod region;
pub mod ring;
pub mod walls;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::frame::sheet::{LINE_PX, PAPER, Sheet, amplified};
use region::Region;

/// Pixels farther than this from contact show the gel at rest, mm.
pub const FAR_MM: f64 = 4.0;

/// An exposure is taken from far pixels where they are this share of the frame or more.
const LEAST_FAR: f64 = 0.05;

/// Gap between the pictures of a row, pixels.
const GAP_PX: usize = 4;

/// How near a predicted picture comes to a real one, of what the press changed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figures {
    /// Mean absolute error, counts.
    pub l1_counts: f64,
    /// The same of the frame at rest taken for the press.
    pub background_l1_counts: f64,
    /// The first over the second.
    pub ratio: f64,
    /// Correlation of predicted and real difference from rest.
    pub correlation: f64,
    /// Peak signal to noise ratio, dB.
    pub psnr_db: f64,
}

impl Figures {
    /// Figures of pairs of a predicted and a real difference from rest, counts; NaN of none.
    pub fn of(pairs: &[[f64; 2]]) -> Self {
        let mean = |value: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(value).sum::<f64>() / pairs.len() as f64;
        let l1_counts = mean(&|[p, d]| (p - d).abs());
        let background_l1_counts = mean(&|[_, d]| d.abs());
        let centred = [mean(&|[p, _]| *p), mean(&|[_, d]| *d)];
        let product = |a: usize, b: usize| mean(&|pair| (pair[a] - centred[a]) * (pair[b] - centred[b]));
        Self {
            l1_counts,
            background_l1_counts,
            ratio: l1_counts / background_l1_counts.max(1e-9),
            correlation: product(0, 1) / (product(0, 0) * product(1, 1)).sqrt().max(1e-9),
            psnr_db: 10.0 * (255.0 * 255.0 / mean(&|[p, d]| (p - d).powi(2)).max(1e-9)).log10(),
        }
    }
}

/// A press as a camera saw it, or as it is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Press<'a> {
    /// The frame of the press.
    pub frame: &'a Frame,
    /// The same sensor at rest.
    pub at_rest: &'a Frame,
}

/// What comparing two pictures gives.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Figures on the pixels compared.
    pub figures: Figures,
    /// The pixels compared.
    pub pixels: Vec<usize>,
    /// Pixels from which the exposures are taken.
    pub n_exposure_pixels: usize,
    /// Mean absolute difference from rest on those pixels, counts: real, simulated.
    pub far_counts: [f64; 2],
    /// Exposure of each channel as a multiple of the frame's at rest: real, simulated.
    pub gains: [[f32; 3]; 2],
    /// What the press changed, interleaved RGB, counts: real, simulated.
    pub differences: [Vec<f32>; 2],
}

impl Press<'_> {
    /// Where the frame shows an edge, its exposure taken from all pixels.
    pub fn contact(&self) -> Result<Region> {
        self.validate("frame")?;
        let size_px = [self.frame.width_px(), self.frame.height_px()];
        let (_, difference) = self.difference(&(0..size_px[0] * size_px[1]).collect::<Vec<_>>());
        Region::of_difference(size_px, &difference)
    }

    /// Refuses a frame at rest of another size.
    fn validate(&self, what: &str) -> Result<()> {
        let [frame, rest] = [self.frame, self.at_rest].map(|frame| [frame.width_px(), frame.height_px()]);
        if frame != rest {
            let expected = format!("{}x{} pixels as its frame at rest", rest[0], rest[1]);
            return Err(Error::invalid(what, expected, format!("{}x{}", frame[0], frame[1])));
        }
        Ok(())
    }

    /// What the press changed once the exposure, taken from some pixels, is compensated: interleaved RGB, counts.
    pub fn difference(&self, exposure: &[usize]) -> ([f32; 3], Vec<f32>) {
        let gain = exposure_gain(self.frame, self.at_rest, exposure);
        let pairs = self.frame.rgb().iter().zip(self.at_rest.rgb()).enumerate();
        (gain, pairs.map(|(i, (frame, rest))| f32::from(*frame) / gain[i % 3] - f32::from(*rest)).collect())
    }
}

/// The pixels from which an exposure is taken: the pixels far from contact, or all pixels where fewer than a
/// twentieth are far.
pub fn far_pixels(n_pixels: usize, is_far: impl Fn(usize) -> bool) -> Vec<usize> {
    let far: Vec<usize> = (0..n_pixels).filter(|pixel| is_far(*pixel)).collect();
    if (far.len() as f64) < LEAST_FAR * n_pixels as f64 { (0..n_pixels).collect() } else { far }
}

/// The exposure of each channel: the median over some pixels of its ratio to the frame at rest. One of no pixels.
pub fn exposure_gain(frame: &Frame, at_rest: &Frame, pixels: &[usize]) -> [f32; 3] {
    [0, 1, 2].map(|channel| {
        let ratio = |pixel: &usize| {
            let [frame, rest] = [frame, at_rest].map(|frame| f32::from(frame.rgb()[3 * pixel + channel]));
            frame.max(1.0) / rest.max(1.0)
        };
        let mut ratios: Vec<f32> = pixels.iter().map(ratio).collect();
        let middle = ratios.len() / 2;
        if ratios.is_empty() { 1.0 } else { *ratios.select_nth_unstable_by(middle, f32::total_cmp).1 }
    })
}

/// Compares two pictures of one press within `band_mm` of its contact; each pixel is `mm_per_px` in x and y.
/// Fails where the sizes differ or nothing is in contact.
pub fn compare(
    real: Press,
    simulated: Press,
    contact: &Region,
    mm_per_px: [f64; 2],
    band_mm: f64,
) -> Result<Comparison> {
    real.validate("real frame")?;
    simulated.validate("simulated frame")?;
    let size_px = [real.frame.width_px(), real.frame.height_px()];
    for (what, got) in
        [("simulated frame", [simulated.frame.width_px(), simulated.frame.height_px()]), ("contact", contact.size_px())]
    {
        if got != size_px {
            let expected = format!("{}x{} pixels as the real frame", size_px[0], size_px[1]);
            return Err(Error::invalid(what, expected, format!("{}x{}", got[0], got[1])));
        }
    }
    if contact.n_pixels() == 0 {
        return Err(Error::invalid("contact", "at least one pixel", "none"));
    }
    let distance_mm = contact.distance_mm(mm_per_px);
    let far = far_pixels(distance_mm.len(), |pixel| distance_mm[pixel] > FAR_MM);
    let (real_gain, real_difference) = real.difference(&far);
    let (simulated_gain, simulated_difference) = simulated.difference(&far);
    let near: Vec<usize> = (0..distance_mm.len()).filter(|pixel| distance_mm[*pixel] <= band_mm).collect();
    let values = near.iter().flat_map(|pixel| 3 * pixel..3 * pixel + 3);
    let pairs: Vec<[f64; 2]> = values.map(|i| [simulated_difference[i], real_difference[i]].map(f64::from)).collect();
    Ok(Comparison {
        figures: Figures::of(&pairs),
        pixels: near,
        n_exposure_pixels: far.len(),
        far_counts: [&real_difference, &simulated_difference].map(|difference| mean_of(difference, &far)),
        gains: [real_gain, simulated_gain],
        differences: [real_difference, simulated_difference],
    })
}

/// Mean absolute value of all channels on some pixels, counts.
fn mean_of(difference: &[f32], pixels: &[usize]) -> f64 {
    let values = pixels.iter().flat_map(|pixel| &difference[3 * pixel..3 * pixel + 3]);
    values.map(|value| f64::from(value.abs())).sum::<f64>() / (3 * pixels.len()).max(1) as f64
}

impl Comparison {
    /// Six pictures: the real frame, the simulated one, and how what they change differs; below them what the
    /// press changed really, what it changes simulated, and white the pixels compared. Changes are amplified on
    /// mid-grey.
    pub fn picture(&self, real: &Frame, simulated: &Frame) -> Result<Frame> {
        let [width, height] = [real.width_px(), real.height_px()];
        let [of_real, of_simulated] = &self.differences;
        let error: Vec<f32> = of_real.iter().zip(of_simulated).map(|(real, simulated)| real - simulated).collect();
        let mut compared = vec![PAPER; 3 * width * height];
        self.pixels.iter().for_each(|pixel| compared[3 * pixel..3 * pixel + 3].fill(255));
        let show = |counts: &[f32]| amplified(counts, [width, height]);
        let panels = [
            [real.clone(), simulated.clone(), show(&error)?],
            [show(of_real)?, show(of_simulated)?, Frame::new(width, height, compared)?],
        ];
        let names = ["real", "simulated", "difference of the changes", "change, real", "change, simulated", "compared"];
        let mut sheet = Sheet::new([3 * (width + GAP_PX) - GAP_PX, 2 * (height + LINE_PX + GAP_PX) - GAP_PX]);
        for (i, (panel, name)) in panels.iter().flatten().zip(names).enumerate() {
            let (x, y) = (i % 3 * (width + GAP_PX), i / 3 * (height + LINE_PX + GAP_PX));
            sheet.put([x, y], panel);
            sheet.write([x, y + height], width, name)?;
        }
        sheet.into_frame()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of 100 x 60 pixels whose value at a pixel is `value(x, y)` in every channel.
    fn frame(value: impl Fn(usize, usize) -> f64) -> Frame {
        let rgb = (0..6_000).flat_map(|i| [value(i % 100, i / 100).round() as u8; 3]).collect();
        Frame::new(100, 60, rgb).unwrap()
    }

    fn square() -> Region {
        Region::new(
            [100, 60],
            (0..6_000).map(|i| (10..20).contains(&(i % 100)) && (20..30).contains(&(i / 100))).collect(),
        )
        .unwrap()
    }

    fn is_square(x: usize, y: usize) -> bool {
        (10..20).contains(&x) && (20..30).contains(&y)
    }

    #[test]
    fn figures_are_those_of_arithmetic() {
        // Predicted and real: means 2.5 and 2, products of deviations 5.5, squares 5 and 6.5.
        let figures = Figures::of(&[[1.0, 0.5], [2.0, 2.0], [3.0, 1.5], [4.0, 4.0]]);
        assert!((figures.l1_counts - 0.5).abs() < 1e-12 && (figures.background_l1_counts - 2.0).abs() < 1e-12);
        assert!((figures.ratio - 0.25).abs() < 1e-12);
        assert!((figures.correlation - 5.0 / (5.0 * 6.5_f64).sqrt()).abs() < 1e-12, "{}", figures.correlation);
        assert!((figures.psnr_db - 10.0 * (65_025.0 / 0.625_f64).log10()).abs() < 1e-9);
    }

    #[test]
    fn a_drifted_exposure_is_taken_out_by_pixels_far_from_contact() {
        let rest = frame(|x, _| 80.0 + 0.5 * x as f64);
        let pressed = |gain: f64, change: f64| {
            frame(move |x, y| gain * (80.0 + 0.5 * x as f64 + if is_square(x, y) { change } else { 0.0 }))
        };
        let (real, simulated) = (pressed(1.1, 40.0), pressed(0.9, 30.0));
        let of = |frame| Press { frame, at_rest: &rest };
        let compared = compare(of(&real), of(&simulated), &square(), [0.125; 2], 0.05).unwrap();
        assert_eq!(compared.pixels.len(), 100);
        // Rounding to whole counts moves a value by half a count and the gain by less than 1 %.
        assert!((compared.figures.l1_counts - 10.0).abs() < 1.0, "{:?}", compared.figures);
        assert!((compared.figures.background_l1_counts - 40.0).abs() < 1.0);
        for (gain, expected) in compared.gains.iter().zip([1.1, 0.9]) {
            assert!(gain.iter().all(|gain| (gain - expected).abs() < 0.01), "{gain:?}");
        }
        // More than 4 mm, 32 pixels, from the square.
        assert_eq!(
            compared.n_exposure_pixels,
            (0..6_000)
                .filter(|i| {
                    let (x, y) = ((i % 100) as f64, (i / 100) as f64);
                    (10.0 - x).max(x - 19.0).max(0.0).hypot((20.0 - y).max(y - 29.0).max(0.0)) > 32.0
                })
                .count()
        );
    }

    #[test]
    fn a_frame_against_itself_is_faultless() {
        let rest = frame(|x, y| 90.0 + (x % 7) as f64 + (y % 5) as f64);
        let pressed =
            frame(|x, y| 90.0 + (x % 7) as f64 + (y % 5) as f64 + if is_square(x, y) { x as f64 } else { 0.0 });
        let press = Press { frame: &pressed, at_rest: &rest };
        let figures = compare(press, press, &square(), [0.1; 2], 1.0).unwrap().figures;
        assert_eq!(figures.l1_counts, 0.0);
        assert!((figures.correlation - 1.0).abs() < 1e-9);
        let same = compare(press, Press { frame: &rest, ..press }, &square(), [0.1; 2], 1.0).unwrap();
        assert_eq!((same.figures.ratio, same.far_counts), (1.0, [0.0; 2]));
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        let rest = frame(|x, _| 80.0 + x as f64);
        let small = Frame::new(10, 6, vec![80; 180]).unwrap();
        let press = Press { frame: &rest, at_rest: &rest };
        let error = |real, simulated, contact: &Region| {
            compare(real, simulated, contact, [0.1; 2], 1.0).unwrap_err().to_string()
        };
        let other = Press { frame: &small, at_rest: &small };
        assert!(error(Press { at_rest: &small, ..press }, press, &square()).starts_with("real frame: expected 10x6"));
        assert!(error(press, other, &square()).starts_with("simulated frame: expected 100x60"));
        let nothing = Region::new([100, 60], vec![false; 6_000]).unwrap();
        assert!(error(press, press, &nothing).starts_with("contact"));
    }
}
