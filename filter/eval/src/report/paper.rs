//! The paper's numbers, for comparison: its tables of accuracy and error on a real robot.

use crate::result::Evaluation;

/// What the paper measured on one of its boards.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperNumbers {
    /// The nearest recorded picture; one touch.
    pub pixel: Option<PaperRow>,
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
    /// Distance to the true place, mm, where the paper has it.
    pub xy_mm: Option<f64>,
    /// Angle to the true angle, degrees, where the paper has it.
    pub theta_deg: Option<f64>,
}

impl PaperRow {
    /// Touches, accuracy in per cent; distance in mm and angle in degrees where there are any.
    const fn new(n_touches: usize, accuracy_percent: f64, errors: Option<(f64, f64)>) -> Self {
        match errors {
            Some((mm, deg)) => Self { n_touches, accuracy_percent, xy_mm: Some(mm), theta_deg: Some(deg) },
            None => Self { n_touches, accuracy_percent, xy_mm: None, theta_deg: None },
        }
    }
}

/// Its Table I: Pixel first, then one touch (MoCo) and more.
const SMALL: [PaperRow; 5] = [
    PaperRow::new(1, 0.0, None),
    PaperRow::new(1, 39.6, Some((0.7, 5.4))),
    PaperRow::new(3, 81.8, Some((0.2, 0.9))),
    PaperRow::new(5, 90.7, Some((0.1, 0.3))),
    PaperRow::new(10, 95.0, Some((0.1, 0.1))),
];
/// Its Table II, alike.
const LARGE: [PaperRow; 5] = [
    PaperRow::new(1, 11.9, Some((6.9, 16.6))),
    PaperRow::new(1, 41.9, Some((4.4, 15.5))),
    PaperRow::new(3, 58.7, Some((1.3, 4.4))),
    PaperRow::new(5, 72.3, Some((1.0, 2.9))),
    PaperRow::new(10, 85.0, Some((0.7, 1.5))),
];
/// Its Table III, alike.
const CONNECTORS: [PaperRow; 2] = [PaperRow::new(1, 50.0, None), PaperRow::new(1, 83.3, None)];

impl PaperNumbers {
    /// The numbers of the paper's board that a scene imitates; none for other scenes.
    pub fn of_scene(scene: &str) -> Self {
        let numbers: &[PaperRow] = match scene {
            "alphabet-small" | "alphabet-small-hard" => &SMALL,
            "alphabet-large" | "alphabet-large-hard" => &LARGE,
            "connectors" => &CONNECTORS,
            _ => &[],
        };
        Self { pixel: numbers.first().copied(), rows: numbers.iter().skip(1).copied().collect() }
    }

    /// The numbers that an evaluation may be compared with: those of its scene, where holes were simulated, chose from as many
    /// parts as the paper and all of them were in a bank of pegs; else none.
    pub fn of(evaluation: &Evaluation) -> Self {
        let n_parts = if evaluation.scene == "connectors" { 6 } else { 12 };
        let comparable = evaluation.n_classes == n_parts && !evaluation.absent && !evaluation.recorded;
        let comparable = comparable && evaluation.side.is_hole() && evaluation.views.is_pegs();
        Self::of_scene(if comparable { &evaluation.scene } else { "" })
    }

    /// The row of one number of touches.
    pub fn at(&self, n_touches: usize) -> Option<&PaperRow> {
        self.rows.iter().find(|row| row.n_touches == n_touches)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::tests::published;
    use tactile_data::dataset::touch::Side;
    use tactile_infer::Views;

    #[test]
    fn fewer_parts_strangers_recordings_pegs_and_known_holes_have_no_number_of_the_paper() {
        let whole: Evaluation = serde_json::from_value(published()).unwrap();
        assert_eq!(PaperNumbers::of(&whole).at(3).unwrap().accuracy_percent, 81.8);
        let few = Evaluation { n_classes: 4, ..whole.clone() };
        let strangers = Evaluation { absent: true, ..whole.clone() };
        let recorded = Evaluation { recorded: true, ..whole.clone() };
        let pegs = Evaluation { side: Side::Peg, ..whole.clone() };
        let both = Evaluation { views: Views::Both, ..whole.clone() };
        for other in [few, strangers, recorded, pegs, both] {
            assert_eq!(PaperNumbers::of(&other), PaperNumbers::of_scene("something else"));
        }
        let connectors = Evaluation { scene: "connectors".into(), n_classes: 6, ..whole };
        let numbers = PaperNumbers::of(&connectors);
        assert_eq!(numbers.pixel.map(|row| row.accuracy_percent), Some(50.0));
        assert_eq!((numbers.rows.len(), numbers.rows[0].xy_mm), (1, None));
    }
}
