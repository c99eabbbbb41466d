//! The gel's surface round a ball, in closed form.
//!
//! Within the contact, radius `a`, the surface is the ball's: slope `r / sqrt(R^2 - r^2)`. Outside it is the
//! membrane of [`crate::sensor::gel`], `D - l^2 lap D = 0`, whose round solution falls as the Bessel function
//! `K_0(r / l)`. Depth and slope go over smoothly at `a`, so that `a` alone says how deep the ball is:
//! `D(a) = slope(a) l K_0(a / l) / K_1(a / l)`.

/// A contact may reach this share of the ball's radius: at its equator the wall is upright.
const MOST_OF_RADIUS: f64 = 0.98;

/// Distance between the places at which the slope is computed, mm.
const STEP_MM: f64 = 0.02;

/// The gel pressed by a ball.
#[derive(Clone, Debug)]
pub struct BallPress {
    /// Slope at every [`STEP_MM`] from the axis.
    slopes: Vec<f64>,
    /// Depth there, mm.
    depths_mm: Vec<f64>,
}

impl BallPress {
    /// A ball of `radius_mm` in contact up to `contact_mm` from its axis, computed up to `reach_mm` from it.
    /// A contact wider than 0.98 of the ball is taken as that.
    pub fn new(radius_mm: f64, contact_mm: f64, gel_length_mm: f64, reach_mm: f64) -> Self {
        let contact_mm = contact_mm.min(MOST_OF_RADIUS * radius_mm);
        let cap = |r: f64| r / (radius_mm * radius_mm - r * r).sqrt();
        let bessel = Bessel::new();
        let at_edge = bessel.k(1, contact_mm / gel_length_mm);
        let slope = |r: f64| {
            if r <= contact_mm {
                return cap(r);
            }
            // Both Bessel functions carry exp(x), which the fall between them takes out again.
            let fall = (-(r - contact_mm) / gel_length_mm).exp();
            cap(contact_mm) * fall * bessel.k(1, r / gel_length_mm) / at_edge
        };
        let n = (reach_mm / STEP_MM).ceil() as usize + 2;
        let slopes: Vec<f64> = (0..n).map(|i| slope(i as f64 * STEP_MM)).collect();
        // The depth is the slope's integral, from the last place's inwards.
        let last_mm = ((n - 1) as f64 * STEP_MM).max(contact_mm);
        let ratio = bessel.k(0, last_mm / gel_length_mm) / bessel.k(1, last_mm / gel_length_mm);
        let mut depths_mm = vec![slope(last_mm) * gel_length_mm * ratio; n];
        for i in (0..n - 1).rev() {
            depths_mm[i] = depths_mm[i + 1] + 0.5 * STEP_MM * (slopes[i] + slopes[i + 1]);
        }
        Self { slopes, depths_mm }
    }

    /// Steepness of the surface `r_mm` from the ball's axis; it deepens towards the axis.
    pub fn slope(&self, r_mm: f64) -> f64 {
        between(&self.slopes, r_mm)
    }

    /// How deep the gel is pressed in `r_mm` from the ball's axis, mm.
    pub fn depth_mm(&self, r_mm: f64) -> f64 {
        between(&self.depths_mm, r_mm)
    }
}

/// Linear between a table's entries; the last one beyond them.
fn between(table: &[f64], r_mm: f64) -> f64 {
    let place = r_mm / STEP_MM;
    let at = (place as usize).min(table.len() - 2);
    let (near, next) = (table[at], table[at + 1]);
    near + (place - at as f64).min(1.0) * (next - near)
}

/// The modified Bessel functions of the second kind, `K_0` and `K_1`.
struct Bessel {
    /// `cosh t` at every step of `t`, the first left out.
    cosh: Vec<f64>,
}

impl Bessel {
    /// Step of the integral's `t`.
    const STEP: f64 = 0.2;

    fn new() -> Self {
        Self { cosh: (1..60).map(|i| (f64::from(i) * Self::STEP).cosh()).collect() }
    }

    /// `exp(x) K_n(x)` for `n` of 0 or 1 and `x` of 0.01 or more: the integral over `t >= 0` of
    /// `exp(-x (cosh t - 1)) cosh(n t)` by the trapezoidal rule, which converges exponentially there (DLMF
    /// 10.32.9).
    fn k(&self, n: i32, x: f64) -> f64 {
        let x = x.max(0.01);
        // What is below exp(-40) does not count.
        let terms = self.cosh.iter().take_while(|cosh| x * (*cosh - 1.0) < 40.0);
        Self::STEP * (0.5 + terms.map(|cosh| (-x * (cosh - 1.0)).exp() * cosh.powi(n)).sum::<f64>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bessel_functions_are_those_of_the_tables() {
        let bessel = Bessel::new();
        // Abramowitz and Stegun, tables 9.8 and 9.9.
        for (n, x, value) in
            [(0, 0.1, 2.427_069), (0, 1.0, 0.421_024_4), (1, 1.0, 0.601_907_2), (1, 5.0, 0.004_044_613)]
        {
            let got = bessel.k(n, x) * f64::exp(-x);
            assert!((got / value - 1.0).abs() < 1e-6, "K_{n}({x}) = {got}");
        }
    }

    #[test]
    fn the_surface_is_the_membrane_s() {
        let (press, bessel) = (BallPress::new(2.35, 1.6, 1.2, 12.0), Bessel::new());
        // The depth by its own closed form, and its second derivative by differences: D'' + D'/r = D / l^2.
        let skirt = |r: f64| press.slope(r) * 1.2 * bessel.k(0, r / 1.2) / bessel.k(1, r / 1.2);
        let cap = |r: f64| (2.35_f64 * 2.35 - r * r).sqrt();
        let depth = |r: f64| skirt(r.max(1.6)) + cap(r.min(1.6)) - cap(1.6);
        for r in [0.0, 1.0, 1.59, 1.61, 3.0] {
            assert!((depth(r) - press.depth_mm(r)).abs() < 2e-3, "{} and {}", depth(r), press.depth_mm(r));
        }
        for r in [2.0, 3.0] {
            let second = (press.slope(r - 0.02) - press.slope(r + 0.02)) / 0.04;
            let balance = second - press.slope(r) / r - depth(r) / 1.44;
            // Linear between steps of 0.02 mm.
            assert!(balance.abs() < 2e-3, "{balance}");
        }
    }
}
