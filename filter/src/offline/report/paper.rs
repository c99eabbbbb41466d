//! The paper's numbers, for comparison: its tables of accuracy and error on a real robot.

/// What the paper measured on one of its boards.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperNumbers {
    /// Share of right parts by the nearest recorded picture, per cent.
    pub pixel_percent: Option<f64>,
    /// The method by touches; the first is the nearest recorded embedding.
    pub rows: Vec<PaperRow>,
}

/// What the paper measured after one number of touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperRow {
    /// Touches, the first included.
    pub n_touches: usize,
    /// Share of right parts, per cent.
    pub accuracy_percent: f64,
    /// Distance to the true place, mm.
    pub xy_mm: f64,
    /// Angle to the true angle, degrees.
    pub theta_deg: f64,
}

/// Touches, accuracy in per cent, distance in mm, angle in degrees.
const SMALL: [(usize, f64, f64, f64); 4] =
    [(1, 39.6, 0.7, 5.4), (3, 81.8, 0.2, 0.9), (5, 90.7, 0.1, 0.3), (10, 95.0, 0.1, 0.1)];
const LARGE: [(usize, f64, f64, f64); 4] =
    [(1, 41.9, 4.4, 15.5), (3, 58.7, 1.3, 4.4), (5, 72.3, 1.0, 2.9), (10, 85.0, 0.7, 1.5)];

impl PaperNumbers {
    /// The numbers of the paper's board that a scene imitates; none for other scenes.
    pub fn of_scene(scene: &str) -> Self {
        let (pixel_percent, rows): (_, &[_]) = match scene {
            "alphabet-small" => (Some(0.0), &SMALL),
            "alphabet-large" => (Some(11.9), &LARGE),
            _ => (None, &[]),
        };
        let row = |&(n_touches, accuracy_percent, xy_mm, theta_deg): &_| PaperRow {
            n_touches,
            accuracy_percent,
            xy_mm,
            theta_deg,
        };
        Self { pixel_percent, rows: rows.iter().map(row).collect() }
    }

    /// The row of one number of touches.
    pub fn at(&self, n_touches: usize) -> Option<&PaperRow> {
        self.rows.iter().find(|row| row.n_touches == n_touches)
    }
}
