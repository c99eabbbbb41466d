//! Camera frames, and the one way from a frame to what the network sees.

#[cfg(feature = "sim")]
pub mod contact_sheet;
#[cfg(feature = "datasets")]
pub mod moved_view;
#[cfg(feature = "sim")]
pub mod npy;
#[cfg(feature = "datasets")]
pub mod picture;
#[cfg(feature = "sim")]
pub(crate) mod sheet;

use serde::{Deserialize, Serialize};

use crate::error::{Error, FrameFault, Result};
use crate::light::lamps::{Lamps, recolour};

/// One RGB frame of a tactile camera, 8 bits a channel, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    width_px: usize,
    height_px: usize,
    rgb: Vec<u8>,
}

impl Frame {
    /// A frame from interleaved RGB bytes, `3 * width_px * height_px` of them.
    pub fn new(width_px: usize, height_px: usize, rgb: Vec<u8>) -> Result<Self> {
        if width_px == 0 || height_px == 0 || rgb.len() != 3 * width_px * height_px {
            return Err(Error::invalid(
                "frame",
                format!("3 x {width_px} x {height_px} bytes"),
                format!("{} bytes", rgb.len()),
            ));
        }
        Ok(Self { width_px, height_px, rgb })
    }

    /// A frame whose length is right by construction.
    #[cfg(feature = "datasets")]
    pub(crate) fn from_parts(width_px: usize, height_px: usize, rgb: Vec<u8>) -> Self {
        debug_assert_eq!(rgb.len(), 3 * width_px * height_px);
        Self { width_px, height_px, rgb }
    }

    /// Width in pixels.
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Height in pixels.
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// Interleaved RGB bytes, rows from the top.
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }
}

/// How frames become network inputs; saved with the model, so that simulated, recorded and live
/// frames are treated the same way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preprocessing {
    /// Width and height of the network's input, pixels.
    pub input_px: [usize; 2],
    /// Width and height of what a training frame showed, mm: an edge's shape only means the same at the
    /// same scale.
    pub field_of_view_mm: [f64; 2],
    /// Mean of each channel over the training set, counts.
    pub mean: [f32; 3],
    /// Standard deviation of each channel over the training set, counts.
    pub std: [f32; 3],
}

impl Preprocessing {
    /// Preprocessing that subtracts no mean and scales by nothing: differences stay in counts. The field of
    /// view is a GelSight Mini's.
    pub fn counts(input_px: [usize; 2]) -> Self {
        Self { input_px, field_of_view_mm: [18.6, 14.3], mean: [0.0; 3], std: [1.0; 3] }
    }

    /// Refuses numbers that no training set has.
    ///
    /// # Errors
    /// The field: a size that is not positive, a mean that is not finite, a deviation that is not positive.
    pub fn validate(&self) -> Result<()> {
        let is_positive = |value: f64| value.is_finite() && value > 0.0;
        let Self { input_px, field_of_view_mm, mean, std } = self;
        if input_px.contains(&0) {
            return Err(Error::invalid("preprocessing.input_px", "positive sizes", format!("{input_px:?}")));
        }
        if !field_of_view_mm.iter().all(|mm| is_positive(*mm)) {
            let got = format!("{field_of_view_mm:?}");
            return Err(Error::invalid("preprocessing.field_of_view_mm", "positive lengths", got));
        }
        if !mean.iter().all(|counts| counts.is_finite()) {
            return Err(Error::invalid("preprocessing.mean", "finite numbers", format!("{mean:?}")));
        }
        if !std.iter().all(|counts| is_positive(f64::from(*counts))) {
            return Err(Error::invalid("preprocessing.std", "positive", format!("{std:?}")));
        }
        Ok(())
    }
}

/// The difference of a frame from the sensor at rest: what a touch did to the picture.
///
/// `[3, height, width]`, channel planes R, G, B, in normalised units (counts where made by
/// [`Preprocessing::counts`]). Signed, nothing clipped. Made only by [`Background::tactile_image`].
#[derive(Clone, Debug, PartialEq)]
pub struct TactileImage {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// `[3, height, width]`.
    pub planes: Vec<f32>,
    /// Share of pixels whose difference from rest exceeds [`EDGE_COUNTS`] in some channel, 0..=1:
    /// how much of the view shows an edge. Zero at rest, and on a plate or a face without edges.
    pub edge_share: f32,
}

/// A difference this large is an edge, not noise, counts. A camera's white noise of 2.5 counts
/// averages below 1 at the network's resolution; an edge pressed 0.5 mm deep makes 40 to 90.
pub const EDGE_COUNTS: f32 = 8.0;

/// The mean of a lit frame is above this, counts. A camera whose lamps are off shows noise of 10 to 16 counts;
/// a GelSight Mini at half its usual exposure has a mean of about 45.
const DARK_COUNTS: f32 = 20.0;

/// The mean of a touch is at least this share of the mean at rest: exposure drifts by a fifth, not to a fifth.
const DARK_SHARE: f32 = 0.2;

/// A frame with a mean above this is saturated, counts.
const SATURATED_COUNTS: f32 = 235.0;

/// Between the lowest and the highest value of a picture are at least this many counts.
const LEAST_CONTRAST_COUNTS: u8 = 8;

/// The sensor at rest: the no-contact frame, reduced once to the network's resolution.
#[derive(Clone, Debug)]
pub struct Background {
    frame_px: [usize; 2],
    mean_counts: f32,
    preprocessing: Preprocessing,
    planes: Vec<f32>,
    /// For each pixel its colours under the lamps that the network knows; `None`: as they are.
    colours: Option<Vec<[[f32; 3]; 3]>>,
}

impl Background {
    /// Prepares the no-contact frame. Fails with [`Error::Frame`] where it is dark, saturated or uniform.
    pub fn new(no_contact: &Frame, preprocessing: &Preprocessing) -> Result<Self> {
        let mean_counts = check_lit(no_contact, "no-contact frame", DARK_COUNTS)?;
        preprocessing.validate()?;
        let [width, height] = preprocessing.input_px;
        if width > no_contact.width_px || height > no_contact.height_px {
            return Err(Error::invalid(
                "no-contact frame",
                format!("at least {width}x{height} pixels"),
                format!("{}x{}", no_contact.width_px, no_contact.height_px),
            ));
        }
        Ok(Self {
            frame_px: [no_contact.width_px, no_contact.height_px],
            mean_counts,
            preprocessing: preprocessing.clone(),
            planes: area_average(no_contact, preprocessing.input_px),
            colours: None,
        })
    }

    /// The same sensor and lamps with another frame at rest. Fails as [`Self::new`].
    pub fn with_rest(&self, no_contact: &Frame) -> Result<Self> {
        Ok(Self { colours: self.colours.clone(), ..Self::new(no_contact, &self.preprocessing)? })
    }

    /// The same sensor, whose lamps are known: its pictures are brought under the lamps of a GelSight Mini
    /// ([`Lamps::default`]), which the network knows. With `None`, or without this, they are taken to be these.
    ///
    /// Fails where the lamps do not show slopes in all directions.
    pub fn lit_by<'a>(mut self, lamps: impl Into<Option<&'a Lamps>>) -> Result<Self> {
        let known = Lamps::default();
        self.colours = match lamps.into() {
            Some(lamps) => {
                lamps.validate()?;
                (*lamps != known).then(|| lamps.change_to(&known, self.preprocessing.input_px))
            }
            None => None,
        };
        Ok(self)
    }

    /// Width and height of the frame at rest, and so of every frame of this sensor, pixels.
    pub fn frame_px(&self) -> [usize; 2] {
        self.frame_px
    }

    /// The frame at rest at the size that a network sees, `[3, height, width]`, counts.
    #[cfg(feature = "sim")]
    pub(crate) fn at_rest(&self) -> &[f32] {
        &self.planes
    }

    /// Subtracts the frame at rest: area average to the input size, exposure compensated per
    /// channel, signed difference, colours as under the lamps that the network knows ([`Self::lit_by`]), then mean and
    /// variance of the training set (paper, Sec. V-A).
    ///
    /// Exposure: the whole frame's gain drifts by -8..+19 % (Sec. 4 of the sensor notes), so each
    /// channel is divided by the median of its ratio to the frame at rest; most of a view is flat
    /// and flat contact does not change colour, so the median is the drift.
    ///
    /// Fails with [`Error::Frame`] where the frame is dark, saturated, uniform or of another size.
    pub fn tactile_image(&self, frame: &Frame) -> Result<TactileImage> {
        let got = [frame.width_px, frame.height_px];
        if got != self.frame_px {
            let fault = FrameFault::WrongSize { expected: self.frame_px, got };
            return Err(Error::Frame { what: "frame".to_owned(), fault });
        }
        check_lit(frame, "frame", DARK_COUNTS.max(DARK_SHARE * self.mean_counts))?;
        let [width, height] = self.preprocessing.input_px;
        let n_pixels = width * height;
        let mut planes = area_average(frame, self.preprocessing.input_px);
        let mut ratios = Vec::with_capacity(n_pixels);
        for (plane, rest) in planes.chunks_mut(n_pixels).zip(self.planes.chunks(n_pixels)) {
            ratios.clear();
            // The bits of numbers that are not negative have the numbers' order, and are found faster.
            ratios.extend(plane.iter().zip(rest).map(|(p, r)| (p / r.max(1.0)).to_bits()));
            let (_, gain, _) = ratios.select_nth_unstable(n_pixels / 2);
            let gain = f32::from_bits(*gain).clamp(0.5, 2.0);
            for (p, r) in plane.iter_mut().zip(rest) {
                *p = *p / gain - r;
            }
        }
        if let Some(colours) = &self.colours {
            recolour(colours, &mut planes);
        }
        let is_edge = |pixel: &usize| (0..3).any(|c| planes[c * n_pixels + pixel].abs() > EDGE_COUNTS);
        let edge_share = (0..n_pixels).filter(is_edge).count() as f32 / n_pixels as f32;
        for (channel, plane) in planes.chunks_mut(n_pixels).enumerate() {
            let (mean, std) = (self.preprocessing.mean[channel], self.preprocessing.std[channel]);
            plane.iter_mut().for_each(|p| *p = (*p - mean) / std);
        }
        Ok(TactileImage { size_px: [width, height], planes, edge_share })
    }
}

/// The mean of a frame, counts. Fails where it is below `least_counts`, or where the frame is saturated or
/// uniform: the camera or its lamps are off, or it is blinded.
fn check_lit(frame: &Frame, what: &str, least_counts: f32) -> Result<f32> {
    let (lowest, highest) = frame.rgb.iter().fold((255, 0), |(low, high), &v| (v.min(low), v.max(high)));
    let sum: u64 = frame.rgb.iter().map(|v| u64::from(*v)).sum();
    let mean_counts = (sum as f64 / frame.rgb.len() as f64) as f32;
    let fault = if mean_counts < least_counts {
        FrameFault::Dark { mean_counts }
    } else if mean_counts > SATURATED_COUNTS {
        FrameFault::Saturated { mean_counts }
    } else if highest - lowest < LEAST_CONTRAST_COUNTS {
        FrameFault::Uniform { lowest, highest }
    } else {
        return Ok(mean_counts);
    };
    Err(Error::Frame { what: what.to_owned(), fault })
}

/// Area average of a frame to `[3, height, width]`, counts. Fractional pixels are shared out.
pub(crate) fn area_average(frame: &Frame, [width, height]: [usize; 2]) -> Vec<f32> {
    let columns = overlaps(frame.width_px, width);
    let rows = overlaps(frame.height_px, height);
    let n_pixels = width * height;
    let mut planes = vec![0.0_f32; 3 * n_pixels];
    let mut line = vec![0.0_f32; 3 * frame.width_px];
    for (row, row_weights) in rows.iter().enumerate() {
        line.fill(0.0);
        for &(y, weight) in row_weights {
            let source = &frame.rgb[3 * y * frame.width_px..3 * (y + 1) * frame.width_px];
            for (sum, &value) in line.iter_mut().zip(source) {
                *sum += weight * f32::from(value);
            }
        }
        for (column, column_weights) in columns.iter().enumerate() {
            let mut sums = [0.0_f32; 3];
            for &(x, weight) in column_weights {
                for (channel, sum) in sums.iter_mut().enumerate() {
                    *sum += weight * line[3 * x + channel];
                }
            }
            for (channel, sum) in sums.into_iter().enumerate() {
                planes[channel * n_pixels + row * width + column] = sum;
            }
        }
    }
    planes
}

/// For each of `n_out` equal bins over `n_in` pixels: the pixels it covers and their weights, which sum to 1.
fn overlaps(n_in: usize, n_out: usize) -> Vec<Vec<(usize, f32)>> {
    let scale = n_in as f64 / n_out as f64;
    (0..n_out)
        .map(|bin| {
            let (start, end) = (bin as f64 * scale, (bin + 1) as f64 * scale);
            (start.floor() as usize..(end.ceil() as usize).min(n_in))
                .map(|pixel| {
                    let covered = (end.min(pixel as f64 + 1.0) - start.max(pixel as f64)).max(0.0);
                    (pixel, (covered / scale) as f32)
                })
                .filter(|(_, weight)| *weight > 0.0)
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient(width: usize, height: usize, gain: f32) -> Frame {
        let rgb = (0..width * height)
            .flat_map(|i| [60 + (i % width) as u8, 100, 110].map(|v| (f32::from(v) * gain).round() as u8))
            .collect();
        Frame::new(width, height, rgb).unwrap()
    }

    #[test]
    fn a_brighter_frame_at_rest_is_still_blank() {
        let rest = gradient(32, 24, 1.0);
        let background = Background::new(&rest, &Preprocessing::counts([8, 6])).unwrap();
        let image = background.tactile_image(&gradient(32, 24, 1.15)).unwrap();
        // Rounding to whole counts leaves at most half a count.
        assert!(image.planes.iter().all(|p| p.abs() < 0.6), "{:?}", image.planes);
        assert_eq!(image.edge_share, 0.0);
    }

    #[test]
    fn differences_keep_their_sign() {
        let rest = gradient(32, 24, 1.0);
        let mut rgb = rest.rgb().to_vec();
        for (x, value) in [(0, 40_i16), (31, -40)] {
            for y in 0..24 {
                let at = 3 * (y * 32 + x);
                rgb[at] = (i16::from(rgb[at]) + value) as u8;
            }
        }
        let background = Background::new(&rest, &Preprocessing::counts([32, 24])).unwrap();
        let image = background.tactile_image(&Frame::new(32, 24, rgb).unwrap()).unwrap();
        assert!((image.planes[0] - 40.0).abs() < 1e-3 && (image.planes[31] + 40.0).abs() < 1e-3);
        assert!((image.edge_share - 2.0 / 32.0).abs() < 1e-6);
    }

    #[test]
    fn a_press_under_known_lamps_looks_as_under_a_minis() {
        // Slopes that vary over the frame, shown by each set of lamps over one frame at rest.
        let rest = Frame::new(
            40,
            30,
            vec![120; 3 * 40 * 30].into_iter().enumerate().map(|(i, v)| v + (i % 17) as u8).collect(),
        )
        .unwrap();
        let place = |at: usize, n: usize| (at as f32 + 0.5) / n as f32 * 2.0 - 1.0;
        let shown = |lamps: &Lamps| {
            let pixel = |i: usize| {
                let (x, y) = (place(i % 40, 40), place(i / 40, 30));
                let slope = [0.25 * (3.0 * y).sin(), 0.2 * (4.0 * x).cos()];
                [0, 1, 2].map(|c| {
                    let response =
                        [&lamps.along_x[c], &lamps.along_y[c]].map(|factors| crate::light::lamps::value(factors, x, y));
                    let change = response[0] * slope[0] + response[1] * slope[1];
                    (f32::from(rest.rgb()[3 * i + c]) + change).round() as u8
                })
            };
            Frame::new(40, 30, (0..1_200).flat_map(pixel).collect()).unwrap()
        };
        let cmu = Lamps::towards([65.0, 45.0, 47.0], [178.0, 62.0, -54.0]);
        let background = Background::new(&rest, &Preprocessing::counts([40, 30])).unwrap();
        let mini = background.tactile_image(&shown(&Lamps::default())).unwrap();
        let plain = background.tactile_image(&shown(&cmu)).unwrap();
        let lit = background.clone().lit_by(&cmu).unwrap();
        let relit = lit.tactile_image(&shown(&cmu)).unwrap();
        let far = |image: &TactileImage| {
            let square = |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>().sqrt();
            let error = square(&mut image.planes.iter().zip(&mini.planes).map(|(a, b)| a - b));
            error / square(&mut mini.planes.iter().copied())
        };
        // What remains: rounding to counts, and the doubt where light is weak, as in a Mini's corners.
        assert!(far(&relit) < 0.35 && far(&plain) > 1.0, "{} {}", far(&relit), far(&plain));
        // A Mini's own lamps change nothing to the bit; another frame at rest keeps the lamps.
        let own = background.clone().lit_by(&Lamps::default()).unwrap();
        assert_eq!(own.tactile_image(&shown(&cmu)).unwrap(), plain);
        assert_eq!(lit.with_rest(&rest).unwrap().tactile_image(&shown(&cmu)).unwrap(), relit);
    }

    #[test]
    fn area_average_keeps_the_mean_at_any_ratio() {
        let frame = gradient(33, 25, 1.0);
        let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
        let all: Vec<f32> = frame.rgb().iter().step_by(3).map(|v| f32::from(*v)).collect();
        let small = area_average(&frame, [7, 4]);
        assert!((mean(&small[..28]) - mean(&all)).abs() < 1e-3);
    }

    /// Noise of `lowest..=highest` counts from a linear congruential generator.
    fn noise(lowest: u8, highest: u8) -> Frame {
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            lowest + ((state >> 16) % u32::from(highest - lowest + 1)) as u8
        };
        Frame::new(32, 24, (0..3 * 32 * 24).map(|_| draw()).collect()).unwrap()
    }

    fn fault<T: std::fmt::Debug>(result: Result<T>) -> FrameFault {
        match result.unwrap_err() {
            Error::Frame { fault, .. } => fault,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn frames_that_show_nothing_are_refused_with_the_fault() {
        let counts = Preprocessing::counts([8, 6]);
        let background = Background::new(&gradient(32, 24, 1.0), &counts).unwrap();
        // Noise of a camera whose lamps are off, with and without an offset of black.
        for dark in [noise(0, 0), noise(0, 16), noise(10, 16), noise(0, 32)] {
            assert!(
                matches!(fault(background.tactile_image(&dark)), FrameFault::Dark { mean_counts } if mean_counts < 17.0)
            );
            assert!(matches!(fault(Background::new(&dark, &counts)), FrameFault::Dark { .. }));
        }
        for white in [noise(255, 255), noise(230, 255)] {
            assert!(
                matches!(fault(background.tactile_image(&white)), FrameFault::Saturated { mean_counts } if mean_counts > 235.0)
            );
        }
        assert_eq!(fault(background.tactile_image(&noise(87, 94))), FrameFault::Uniform { lowest: 87, highest: 94 });
        let wrong_size = FrameFault::WrongSize { expected: [32, 24], got: [16, 24] };
        assert_eq!(fault(background.tactile_image(&gradient(16, 24, 1.0))), wrong_size);
    }

    #[test]
    fn a_frame_far_darker_than_at_rest_is_refused_and_half_its_exposure_is_not() {
        let counts = Preprocessing::counts([8, 6]);
        let bright = Background::new(&gradient(32, 24, 2.0), &counts).unwrap();
        let dim = |gain| bright.tactile_image(&gradient(32, 24, gain));
        assert!(matches!(fault(dim(0.35)), FrameFault::Dark { .. }));
        assert!(dim(1.0).is_ok() && dim(0.5).is_ok());
        // A Mini at half its exposure: about 45 counts.
        Background::new(&gradient(32, 24, 0.48), &counts).unwrap();
    }
}
