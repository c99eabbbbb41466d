//! What touching a scene takes: said before the work, and refused where this machine does not have it.

use std::fmt;

use crate::error::Result;
use crate::file::output;
use crate::sensor::gel;

/// The memory and the touches that a scene takes, at least.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// Parts that are touched.
    pub n_parts: usize,
    /// Touches that are rendered.
    pub n_touches: usize,
    /// What is kept of each side that was touched, bytes: the gel pressed onto it.
    pub memory_bytes: f64,
}

impl Needs {
    /// What touching so many parts needs, each on so many sides, where a scene's gel reaches `half_extent_mm` from the
    /// middle of a part ([`Scene::half_extent_mm`](crate::scene::Scene::half_extent_mm)).
    pub fn of(half_extent_mm: f64, n_parts: usize, n_sides: usize, n_touches: usize) -> Self {
        let side_bytes = gel::least_bytes(half_extent_mm);
        Self { n_parts, n_touches, memory_bytes: n_parts as f64 * n_sides as f64 * side_bytes }
    }

    /// Whether they are worth a word: a gigabyte, or a million touches, which take an hour or so.
    pub fn is_much(&self) -> bool {
        self.memory_bytes >= 1e9 || self.n_touches >= 1_000_000
    }

    /// Refuses what this machine's memory cannot hold.
    ///
    /// # Errors
    /// What is needed.
    pub fn check(&self) -> Result<()> {
        let Self { n_parts, n_touches, .. } = self;
        output::check_memory("scene", format!("{n_parts} parts and {n_touches} touches"), self.memory_bytes)
    }
}

impl fmt::Display for Needs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n_parts, n_touches, memory_bytes } = self;
        let memory = output::size(*memory_bytes);
        write!(f, "{n_parts} parts and {n_touches} touches, which take {memory} of memory or more")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::grid::PoseGrid;
    use crate::scene::Scene;

    #[test]
    fn the_memory_is_that_of_the_gel_on_each_side() {
        let scene = Scene::preset("alphabet-small").unwrap();
        let needs = Needs::of(scene.half_extent_mm(), 12, 2, 24 * PoseGrid::SMALL.len());
        // Within 8 + 2 mm and half the view's diagonal of 23.5 mm, and 1 mm, in cells of 0.1 mm, each an f32.
        let half_mm: f64 = 8.0 + 2.0 + 0.5 * 18.6_f64.hypot(14.3) + 1.0;
        assert!((needs.memory_bytes / (24.0 * 4.0 * (20.0 * half_mm).powi(2)) - 1.0).abs() < 0.01, "{needs}");
        assert!(!needs.is_much() && needs.check().is_ok());
        assert_eq!(needs.to_string(), "12 parts and 4200 touches, which take 19.8 MB of memory or more");
    }

    #[test]
    fn what_no_machine_holds_is_refused() {
        let scene = Scene::preset("alphabet-small").unwrap();
        let needs = Needs::of(scene.half_extent_mm(), 10_000_000, 2, usize::MAX);
        assert!(needs.is_much());
        let error = needs.check().unwrap_err().to_string();
        assert!(error.starts_with("scene: expected work that fits") && error.contains("10000000 parts and"), "{error}");
    }
}
