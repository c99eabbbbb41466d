//! The part of a view that an episode knows.

use tactile_data::se2::Se2;
use tactile_filter::{Episode, Estimate};

use super::view::{Part, Place, PlaceMap, View};

impl View {
    /// What an episode believes: parts with their maps, place and entropy. The rest is for the node to fill in.
    /// `parts`: the names of the bank's parts; `estimate`: what the episode estimates.
    pub fn of_episode(episode: &Episode, parts: &[String], estimate: &Estimate) -> Self {
        let probabilities = episode.belief().class_posterior().iter();
        let part = |((name, map), probability): ((&String, PlaceMap), &f64)| Part {
            name: name.clone(),
            probability: *probability,
            map: Some(map),
        };
        let mut view = Self {
            parts: parts.iter().zip(maps(episode, parts.len())).zip(probabilities).map(part).collect(),
            place: Some(Place::of(estimate)),
            entropy_nats: Some(estimate.entropy_nats),
            ..Self::default()
        };
        view.sort();
        view
    }
}

impl Place {
    /// What an estimate says of it.
    pub fn of(estimate: &Estimate) -> Self {
        let [[xx, ..], [_, yy, _], [.., tt]] = estimate.covariance;
        Self {
            part: estimate.part.clone(),
            probability: estimate.probability,
            part_from_sensor: estimate.part_from_sensor,
            sd_mm: [xx.max(0.0).sqrt(), yy.max(0.0).sqrt()],
            sd_deg: tt.max(0.0).sqrt().to_degrees(),
        }
    }
}

/// Where the sensor may be now on each part, in cells of the belief's own step; what lies outside is left out.
fn maps(episode: &Episode, n_parts: usize) -> Vec<PlaceMap> {
    let belief = episode.belief();
    let (grid, first_from_sensor) = (belief.grid(), belief.first_from_sensor());
    let (n_xy, half_mm) = (grid.n_xy(), grid.xy_half_mm);
    let empty = PlaceMap { n_xy, half_mm, values: vec![0.0; n_xy * n_xy] };
    let mut maps = vec![empty; n_parts];
    let index = |mm: f64| {
        let steps = ((mm + half_mm) / grid.xy_step_mm).round();
        (0.0..n_xy as f64).contains(&steps).then_some(steps as usize)
    };
    for (state, probability) in belief.states() {
        let Se2 { x_mm, y_mm, .. } = grid.pose(state.cell) * first_from_sensor;
        if let (Some(x), Some(y), Some(map)) = (index(x_mm), index(y_mm), maps.get_mut(state.part)) {
            map.values[x * n_xy + y] += probability;
        }
    }
    maps
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use tactile_data::grid::PoseGrid;
    use tactile_filter::{EpisodeConfig, Observation};
    use tactile_infer::Bank;
    use tactile_infer::rows::Rows;

    #[test]
    fn an_episodes_maps_add_up_to_its_parts_and_move_with_the_sensor() {
        // Two parts at 5 x 5 places and one angle; the view of the second at x = -4, y = 0 alone is touched.
        let grid = PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };
        let touched = 25 + 2;
        let rows: Vec<f32> = (0..50).flat_map(|row| if row == touched { [1.0, 0.0] } else { [0.0, 1.0] }).collect();
        let parts = vec!["A".to_owned(), "B".to_owned()];
        let rows = Rows::new(2, rows).unwrap();
        let bank = Arc::new(Bank::from_rows(parts.clone(), grid, rows, vec![0.2; 50], "").unwrap());
        let config = EpisodeConfig { subdivisions: 1, ..EpisodeConfig::default() };
        let observation = |x: f32, y: f32| Observation::new(vec![x, y], 0.2);
        let mut episode = Episode::begin(config, bank, &observation(1.0, 0.0)).unwrap();
        let view = View::of_episode(&episode, &parts, &episode.estimate());
        assert_eq!((view.parts[0].name.as_str(), view.place.as_ref().unwrap().part.as_str()), ("B", "B"));
        for part in &view.parts {
            let sum: f64 = part.map.as_ref().unwrap().values.iter().sum();
            assert!((sum - part.probability).abs() < 1e-12, "{sum} of {}", part.probability);
        }
        let brightest = |view: &View| {
            let map = view.parts.iter().find(|part| part.name == "B").unwrap().map.clone().unwrap();
            (0..25).max_by(|a, b| map.values[*a].total_cmp(&map.values[*b])).unwrap()
        };
        assert_eq!(brightest(&view), 2);
        // Four millimetres along x are two columns of five cells.
        episode.observe(Se2::new(4.0, 0.0, 0.0), &observation(0.0, 1.0)).unwrap();
        assert_eq!(brightest(&View::of_episode(&episode, &parts, &episode.estimate())), 2 + 2 * 5);
    }
}
