//! Shadows: light from one side that the gel's own surface keeps off.
//!
//! A place is in a lamp's shadow where the surface towards the lamp rises above the line at the lamp's
//! elevation through it. The membrane's skirt already gives the soft dark side of a contact; what is here
//! is the cast shadow alone, the tier above the optics.
//!
//! On recorded presses of a ball it adds nothing: the default, which fits them best, changes the error of the
//! contact by less than 0.05 counts of 6, and lower or stronger lamps (10 degrees, 3 %) make it 0.7 counts
//! worse, since the light of such a sensor is diffuse. The test `shadows_add_nothing_to_presses_of_a_ball` in
//! `data/tests/real.rs` measures it again. A rig of few, hard lamps says so in its own [`Shadow`].

use super::light::Shadow;
use super::optics::Optics;

/// Darkens shaded RGB counts where depths `[height + 2, width + 2]` in mm keep a lamp's light off.
pub fn cast(rgb: &mut [f32], depths: &[f32], optics: &Optics, mm_per_px: [f64; 2]) {
    let [width, height] = optics.size_px();
    let Shadow { elevation_deg, strength, soft_mm } = optics.rig().shadow;
    let fall = elevation_deg.to_radians().tan();
    for channel in 0..3 {
        let [x, y] = [&optics.rig().along_x, &optics.rig().along_y].map(|factors| f64::from(factors[channel][0]));
        let length = x.hypot(y);
        if length == 0.0 || strength == 0.0 {
            continue;
        }
        // Slopes that deepen away from a lamp face it: the lamp is where the response is least.
        let lit = horizon(depths, [width + 2, height + 2], mm_per_px, [-x / length, -y / length], fall);
        for (row, line) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let inner = (row + 1) * (width + 2) + 1..(row + 2) * (width + 2) - 1;
            let places = lit[inner.clone()].iter().zip(&depths[inner]);
            for (pixel, (lit, depth)) in line.as_chunks_mut::<3>().0.iter_mut().zip(places) {
                pixel[channel] *= 1.0 - strength as f32 * ((lit - depth) / soft_mm as f32).min(1.0);
            }
        }
    }
}

/// For each place the depth below which its lamp's light is kept off: the running maximum along the light,
/// which falls `fall` mm a mm. One pass from the lamp's side, a pixel at a time along the axis nearer to the
/// light; between two pixels of the other axis it is linear.
fn horizon(depths: &[f32], size_px: [usize; 2], mm_per_px: [f64; 2], towards_lamp: [f64; 2], fall: f64) -> Vec<f32> {
    let towards_px = [0, 1].map(|axis| towards_lamp[axis] / mm_per_px[axis]);
    let along = usize::from(towards_px[1].abs() > towards_px[0].abs());
    let across = 1 - along;
    let stride = [1, size_px[0]];
    let shift = towards_px[across] / towards_px[along].abs();
    let drop_mm = (fall * mm_per_px[along].hypot(shift * mm_per_px[across])) as f32;
    let (whole, fraction) = (shift.floor() as isize, (shift - shift.floor()) as f32);
    let n = size_px.map(|side| side as isize);
    let mut lit = depths.to_vec();
    for step in 1..size_px[along] {
        let back = towards_px[along] > 0.0;
        let line = if back { size_px[along] - 1 - step } else { step };
        let before = if back { line + 1 } else { line - 1 };
        // Both neighbours towards the lamp must be on the frame.
        let first = (-whole).clamp(0, n[across]) as usize;
        let end = (n[across] - 1 - whole).clamp(0, n[across]) as usize;
        for place in first..end {
            let source = before * stride[along] + place.wrapping_add_signed(whole) * stride[across];
            let (near, next) = (lit[source], lit[source + stride[across]]);
            let at = line * stride[along] + place * stride[across];
            lit[at] = lit[at].max(near + fraction * (next - near) - drop_mm);
        }
    }
    lit
}

#[cfg(test)]
mod tests {
    use super::super::SensorSpec;
    use super::super::light::LightRig;
    use super::*;

    /// A smooth bump 1 mm high: from each place a ray is marched to the lamp in steps of 0.01 mm.
    #[test]
    fn the_pass_is_a_march_to_the_lamp() {
        let (mm_per_px, fall) = ([0.1, 0.12], 0.4);
        let depth = |x: f64, y: f64| (-((x - 20.0) * 0.1 / 1.2).powi(2) - ((y - 15.0) * 0.12).powi(2)).exp();
        let depths: Vec<f32> = (0..40 * 30).map(|i| depth(f64::from(i % 40), f64::from(i / 40)) as f32).collect();
        for deg in [0.0_f64, 90.0, 180.0, -90.0, 30.0, 200.0, 110.0] {
            let towards = [deg.to_radians().cos(), deg.to_radians().sin()];
            let lit = horizon(&depths, [40, 30], mm_per_px, towards, fall);
            // Away from the border, beyond which nothing is known.
            for (row, column) in (8..22).flat_map(|row| (8..32).map(move |column| (row, column))) {
                let marched = (0..250).map(|step| 0.01 * f64::from(step)).map(|mm| {
                    let [x, y] = [0, 1].map(|axis| mm * towards[axis] / mm_per_px[axis]);
                    depth(f64::from(column) + x, f64::from(row) + y) - mm * fall
                });
                let (above, got) = (marched.fold(0.0, f64::max), f64::from(lit[(row * 40 + column) as usize]));
                // Linear interpolation lowers the bump's top, curvature 2 / mm^2, by 0.003 mm a pixel at most.
                assert!((got - above).abs() < 0.03, "{deg} degrees, {column}, {row}: {got}, not {above}");
            }
        }
    }

    #[test]
    fn a_flat_gel_has_no_shadow_and_a_step_has_one_on_the_far_side() {
        // The red lamp's light travels along +x, so that it is on the left.
        let light = LightRig::lamps([80.0, 0.0, 0.0], [0.0; 3]);
        let shadow = Shadow { elevation_deg: 10.0, strength: 0.2, soft_mm: 0.05 };
        let light = LightRig { shadow, ..light };
        let spec = SensorSpec { frame_px: [40, 8], field_of_view_mm: [4.0, 0.8], light, ..SensorSpec::default() };
        let optics = Optics::new(&spec);
        let flat = vec![0.3; 42 * 10];
        let mut rgb = vec![100.0; 3 * 40 * 8];
        cast(&mut rgb, &flat, &optics, spec.mm_per_px());
        assert!(rgb.iter().all(|counts| *counts == 100.0));
        let step: Vec<f32> = (0..42 * 10).map(|i| if i % 42 < 11 { 0.3 } else { 0.0 }).collect();
        cast(&mut rgb, &step, &optics, spec.mm_per_px());
        let red = |column: usize| rgb[3 * (4 * 40 + column)];
        // The step's edge is at the tenth pixel of the frame; its shadow is as long as the lamp is low.
        let length_px = (0.3 / 10.0_f64.to_radians().tan() / 0.1) as usize;
        assert_eq!(red(9), 100.0);
        assert!((red(12) - 80.0).abs() < 1e-3, "{}", red(12));
        assert_eq!(red(10 + length_px + 1), 100.0);
        assert!(rgb.iter().skip(1).step_by(3).all(|counts| *counts == 100.0));
    }
}
