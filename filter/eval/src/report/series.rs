//! The rows of an evaluation as curves.

use crate::page::curves::{Line, Marker, Point};
use crate::result::{Choice, Evaluation, Inference, Method, Poses, Row, Stops};

/// One way of inferring over its numbers of touches.
pub struct Series<'a> {
    /// How the part was named.
    pub method: Method,
    /// How the belief was kept.
    pub inference: Inference,
    /// How touches were chosen.
    pub action: Choice,
    /// By ascending number of touches.
    pub rows: Vec<&'a Row>,
}

impl<'a> Series<'a> {
    /// Its name in a legend.
    pub fn label(&self) -> String {
        match self.method {
            Method::Pixel => "Pixel, one touch".into(),
            Method::Moco => "MoCo, one touch".into(),
            Method::Filter => format!("Filter, {}", self.way()),
        }
    }

    /// How the filter infers and acts.
    pub fn way(&self) -> String {
        way(self.inference, self.action)
    }

    /// Its class of the style and its mark.
    pub fn class_and_marker(&self) -> (String, Marker) {
        let (class, marker) = match self.method {
            Method::Pixel => ("pixel", Marker::Cross),
            Method::Moco => ("moco", Marker::Square),
            Method::Filter => choice_class_and_marker(self.action),
        };
        let particle = if self.inference == Inference::Particle { " particle" } else { "" };
        (format!("{class}{particle}"), marker)
    }

    /// Its row of one number of touches.
    pub fn at(&self, n_touches: usize) -> Option<&'a Row> {
        self.rows.iter().copied().find(|row| row.n_touches == n_touches)
    }

    /// Its curve of a value and, where known, its interval.
    pub fn line(&self, value: impl Fn(&Row) -> (f64, Option<[f64; 2]>)) -> Line {
        let (class, marker) = self.class_and_marker();
        let point = |row: &&Row| {
            let (value, interval) = value(row);
            Point { n_touches: row.n_touches, value, interval }
        };
        Line { label: self.label(), class, marker, points: self.rows.iter().map(point).collect() }
    }
}

/// How a filter infers and acts, in words.
pub fn way(inference: Inference, action: Choice) -> String {
    let inference = match inference {
        Inference::Exact => "exact",
        Inference::Particle => "particles",
        Inference::None => "no inference",
    };
    format!("{inference}, {}", choice(action))
}

/// How touches are chosen, in words.
pub fn choice(action: Choice) -> &'static str {
    match action {
        Choice::Paper => "the paper’s action rule",
        Choice::Information => "most informative action",
        Choice::Random => "random action",
        Choice::RandomEdge => "random action that should show an edge",
        Choice::None => "no action",
    }
}

/// The colour of a rule of choice, as a class of the style, and its mark.
pub fn choice_class_and_marker(action: Choice) -> (&'static str, Marker) {
    match action {
        Choice::Paper => ("paper-rule", Marker::Square),
        Choice::Information | Choice::None => ("information", Marker::Circle),
        Choice::Random => ("random", Marker::Triangle),
        Choice::RandomEdge => ("random", Marker::Square),
    }
}

/// Every way of inferring with poses of one kind: filters first, then the baselines.
pub fn series(evaluation: &Evaluation, poses: Poses) -> Vec<Series<'_>> {
    let mut rows: Vec<&Row> = evaluation.rows.iter().filter(|row| row.poses == poses).collect();
    let way = |row: &Row| (row.method, row.inference, row.action);
    rows.sort_by_key(|row| (std::cmp::Reverse(row.method), row.inference, row.action, row.n_touches));
    let same = rows.chunk_by(|a, b| way(a) == way(b));
    same.map(|rows| {
        let (method, inference, action) = way(rows[0]);
        Series { method, inference, action, rows: rows.to_vec() }
    })
    .collect()
}

/// The filter that the evaluation is about: the one that its rows name first, whose stopping and latency it has.
pub fn leading_filter(evaluation: &Evaluation, poses: Poses) -> Option<Series<'_>> {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter && row.poses == poses)?;
    let is_lead = |series: &Series| {
        (series.method, series.inference, series.action) == (lead.method, lead.inference, lead.action)
    };
    series(evaluation, poses).into_iter().find(is_lead)
}

/// What the stopping rule did with the leading filter.
pub fn leading_stops(evaluation: &Evaluation) -> Option<&Stops> {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter)?;
    evaluation.stops.iter().find(|stops| (stops.inference, stops.action) == (lead.inference, lead.action))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result;

    #[test]
    fn rows_are_grouped_by_way_and_the_first_leads() {
        let mut evaluation: Evaluation = serde_json::from_value(result::tests::published()).unwrap();
        let row = evaluation.rows[0].clone();
        let other = |action, n_touches, accuracy| Row { action, n_touches, accuracy, ..row.clone() };
        evaluation.rows = vec![
            other(Choice::Random, 3, 0.6),
            other(Choice::Information, 3, 0.8),
            other(Choice::Random, 1, 0.5),
            other(Choice::Information, 1, 0.4),
            Row { poses: Poses::OffGrid, ..row.clone() },
        ];
        let found = series(&evaluation, Poses::OnGrid);
        let touches = |series: &Series| series.rows.iter().map(|row| row.n_touches).collect::<Vec<_>>();
        assert_eq!(found.iter().map(touches).collect::<Vec<_>>(), [[1, 3], [1, 3]]);
        assert_eq!(leading_filter(&evaluation, Poses::OnGrid).unwrap().action, Choice::Random);
    }
}
