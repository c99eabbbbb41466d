//! Outlines with curves, cut into straight pieces.

use super::Contour;

/// Collects contours from a pen that draws lines and Bezier curves.
#[derive(Debug)]
pub(super) struct Flatten {
    /// The contours so far.
    pub contours: Vec<Contour>,
    /// Straight pieces a curve is cut into.
    pieces: usize,
    at: [f64; 2],
}

impl Flatten {
    /// A pen that cuts each curve into so many pieces.
    pub fn new(pieces: usize) -> Self {
        Self { contours: Vec::new(), pieces, at: [0.0; 2] }
    }

    /// Begins a contour.
    pub fn start(&mut self, at: [f64; 2]) {
        self.contours.push(Vec::new());
        self.line(at);
    }

    /// A straight line.
    pub fn line(&mut self, to: [f64; 2]) {
        self.at = to;
        if let Some(contour) = self.contours.last_mut() {
            contour.push(to);
        }
    }

    /// A curve with one control point.
    pub fn quadratic(&mut self, b: [f64; 2], c: [f64; 2]) {
        let a = self.at;
        for i in 1..=self.pieces {
            let t = i as f64 / self.pieces as f64;
            let s = 1.0 - t;
            self.line([0, 1].map(|k| s * s * a[k] + 2.0 * s * t * b[k] + t * t * c[k]));
        }
    }

    /// A curve with two control points.
    pub fn cubic(&mut self, b: [f64; 2], c: [f64; 2], d: [f64; 2]) {
        let a = self.at;
        for i in 1..=self.pieces {
            let t = i as f64 / self.pieces as f64;
            let s = 1.0 - t;
            let mix = |k: usize| s.powi(3) * a[k] + 3.0 * s * s * t * b[k] + 3.0 * s * t * t * c[k] + t.powi(3) * d[k];
            self.line([0, 1].map(mix));
        }
    }
}
