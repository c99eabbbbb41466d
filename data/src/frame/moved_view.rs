//! What a sensor would have seen from a little further on.

use crate::frame::Frame;
use crate::pose::se2::Se2;

/// The frame that the sensor would see if it were moved by `sensor_from_view`: what the touch adds to rest, taken from
/// where it then is, on rest. Outside the frame the picture is taken to go on as at its border: an edge that is not
/// there would say more than it hides. Both frames have one size, pixels of `mm_per_px`.
pub fn moved_view(rest: &Frame, frame: &Frame, sensor_from_view: &Se2, mm_per_px: [f64; 2]) -> Frame {
    let (width, height) = (rest.width_px(), rest.height_px());
    let centre = [width, height].map(|n| 0.5 * (n as f64 - 1.0));
    let mut rgb = Vec::with_capacity(rest.rgb().len());
    for (pixel, at_rest) in rest.rgb().chunks_exact(3).enumerate() {
        let px = [(pixel % width) as f64, (pixel / width) as f64];
        let there = sensor_from_view.apply([0, 1].map(|axis| (px[axis] - centre[axis]) * mm_per_px[axis]));
        let added = difference_at(rest, frame, [0, 1].map(|axis| there[axis] / mm_per_px[axis] + centre[axis]));
        rgb.extend(at_rest.iter().zip(added).map(|(value, d)| (f32::from(*value) + d).round().clamp(0.0, 255.0) as u8));
    }
    Frame::from_parts(width, height, rgb)
}

/// What a frame adds to rest between pixels, by their bilinear mean, counts; outside, what it adds at its border.
pub fn difference_at(rest: &Frame, frame: &Frame, [x, y]: [f64; 2]) -> [f32; 3] {
    let (width, height) = (rest.width_px(), rest.height_px());
    let (x, y) = (x.clamp(0.0, (width - 1) as f64), y.clamp(0.0, (height - 1) as f64));
    let (left, top) = (x as usize, y as usize);
    let (fx, fy) = ((x - left as f64) as f32, (y - top as f64) as f32);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let corners = [
        (left, top, (1.0 - fx) * (1.0 - fy)),
        (right, top, fx * (1.0 - fy)),
        (left, bottom, (1.0 - fx) * fy),
        (right, bottom, fx * fy),
    ];
    let mut sum = [0.0; 3];
    for (column, row, weight) in corners {
        let at = 3 * (row * width + column);
        for (c, sum) in sum.iter_mut().enumerate() {
            *sum += weight * (f32::from(frame.rgb()[at + c]) - f32::from(rest.rgb()[at + c]));
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const MM: [f64; 2] = [0.5, 0.4];

    fn blob(cx: f64, cy: f64) -> Frame {
        let value = |i: usize| {
            let (x, y) = ((i / 3 % 40) as f64 - 19.5 - cx, (i / 3 / 40) as f64 - 14.5 - cy);
            (100.0 + 90.0 * (-(x * x + y * y) / 18.0).exp()) as u8
        };
        Frame::new(40, 30, (0..3_600).map(value).collect()).unwrap()
    }

    #[test]
    fn a_sensor_that_goes_on_sees_the_same_further_back() {
        let rest = Frame::new(40, 30, vec![100; 3_600]).unwrap();
        // By 2.5 px to the right and 1 px up; then turned by 90 degrees, which takes (4, 2) px to (x, y) of other sizes.
        let shifted = moved_view(&rest, &blob(0.0, 0.0), &Se2::new(1.25, -0.4, 0.0), MM);
        assert!(shifted.rgb().iter().zip(blob(-2.5, 1.0).rgb()).all(|(a, b)| a.abs_diff(*b) <= 2));
        let turn = Se2::from_degrees(0.0, 0.0, 180.0);
        let turned = moved_view(&rest, &blob(4.0, 2.0), &turn, MM);
        assert!(turned.rgb().iter().zip(blob(-4.0, -2.0).rgb()).all(|(a, b)| a.abs_diff(*b) <= 1));
    }

    #[test]
    fn a_sensor_that_stays_sees_the_same_bytes() {
        let rest = Frame::new(40, 30, (0..3_600).map(|i| (i % 200) as u8).collect()).unwrap();
        let frame = blob(3.0, -2.0);
        assert_eq!(moved_view(&rest, &frame, &Se2::IDENTITY, MM), frame);
        // Far outside, a level touch goes on.
        let level = Frame::new(40, 30, rest.rgb().iter().map(|v| v + 20).collect()).unwrap();
        assert_eq!(moved_view(&rest, &level, &Se2::new(100.0, 0.0, 0.0), MM), level);
    }
}
