//! The evaluation as one HTML file: no network, two small scripts that sort tables and leaf through episodes, for a
//! screen or a printer. Without scripts every touch is shown.

pub(crate) mod comparison;
pub(crate) mod curves;
mod next;
mod page;
mod paper;
mod parts;
mod picture;
mod reliability;
mod scatter;
pub(crate) mod series;
pub(crate) mod shell;
mod stopping;
pub(crate) mod story;
mod style;
pub(crate) mod table;
pub mod tradeoff;
mod viewer;

use std::fs;
use std::io;
use std::path::Path;

use tactile_data::frame::{Frame, TactileImage};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;

use super::result::Evaluation;
pub use paper::{PaperNumbers, PaperRow};
use tactile_filter::action::{ActionRule, Judgement};

/// What all episodes of an evaluation share.
#[derive(Clone, Debug)]
pub struct Board {
    /// The parts, in the order of the bank.
    pub parts: Vec<PartPicture>,
    /// Where each part was recorded.
    pub grid: PoseGrid,
    /// Width and height of what a frame shows, mm.
    pub field_of_view_mm: [f64; 2],
}

/// A part as it is drawn.
#[derive(Clone, Debug)]
pub struct PartPicture {
    /// Its name.
    pub name: String,
    /// Closed contours in the part's frame, mm, filled where their winding number is not nought.
    pub outline_mm: Vec<Vec<[f64; 2]>>,
}

/// One episode, told touch by touch.
#[derive(Clone, Debug)]
pub struct EpisodeStory {
    /// What to call it: its number; no two of a report are called the same.
    pub name: String,
    /// Why it is told, in a few words.
    pub why: String,
    /// The true part, an index into [`Board::parts`].
    pub truth: usize,
    /// Why it ended, in a few words.
    pub stop: String,
    /// Whether it ended because no part explains the touches.
    pub refused: bool,
    /// The touches, in order; at least one.
    pub touches: Vec<TouchStory>,
}

/// One touch: where it was, what was seen and what was believed after it.
#[derive(Clone, Debug)]
pub struct TouchStory {
    /// True pose of the sensor on the true part.
    pub part_from_sensor: Se2,
    /// What the camera saw.
    pub frame: Frame,
    /// What the network saw.
    pub difference: TactileImage,
    /// The part named after it, an index into [`Board::parts`].
    pub guess: usize,
    /// Probability of `guess`, 0..=1.
    pub probability: f64,
    /// Believed pose of the sensor on `guess`.
    pub guess_from_sensor: Se2,
    /// How well `guess` explains the touches so far, nats: [`tactile_filter::Estimate::fit`]; `None` where no
    /// edge was felt.
    pub fit: Option<f64>,
    /// The least `fit` with which the filter would be confident after this touch; `None` for any.
    pub fit_needed: Option<f64>,
    /// Probability of each place of the first touch, summed over the angle; sums to 1.
    ///
    /// `[part, x, y]`, y fastest: the order of [`PoseGrid::pose`] without its angle.
    pub belief: Vec<f64>,
    /// How the next touch was chosen; `None` after the last.
    pub next: Option<NextTouch>,
}

/// The choice of a next touch.
#[derive(Clone, Debug)]
pub struct NextTouch {
    /// The rule that chose.
    pub rule: ActionRule,
    /// Motions that the reach allowed.
    pub n_candidates: usize,
    /// What was chosen, and why.
    pub judgement: Judgement,
}

/// Writes the report of an evaluation with the stories of some of its episodes, beside the paper's numbers.
///
/// The file is written beside `path` and then renamed. Fails where that is not possible, or with
/// [`io::ErrorKind::InvalidInput`] where a story does not fit the board.
pub fn write_report(
    path: &Path,
    evaluation: &Evaluation,
    board: &Board,
    episodes: &[EpisodeStory],
    paper: &PaperNumbers,
) -> io::Result<()> {
    episodes.iter().try_for_each(|episode| check(episode, board))?;
    let html = page::html(evaluation, board, episodes, paper)?;
    let beside = path.with_extension("html.partial");
    fs::write(&beside, html)?;
    fs::rename(&beside, path)
}

fn check(episode: &EpisodeStory, board: &Board) -> io::Result<()> {
    let n_parts = board.parts.len();
    let n_values = n_parts * board.grid.n_xy().pow(2);
    let wrong = |reason: String| io::Error::new(io::ErrorKind::InvalidInput, format!("{}: {reason}", episode.name));
    if episode.touches.is_empty() {
        return Err(wrong("expected at least one touch, got none".into()));
    }
    let pairs = episode.touches.iter().filter_map(|touch| touch.next.as_ref()?.judgement.expected?.pair);
    let judged_parts = pairs.flat_map(|(pair, _)| pair);
    let named = episode.touches.iter().map(|touch| touch.guess).chain([episode.truth]).chain(judged_parts);
    if let Some(part) = named.into_iter().find(|part| *part >= n_parts) {
        return Err(wrong(format!("expected one of {n_parts} parts, got part {part}")));
    }
    for (touch, n) in episode.touches.iter().zip(1..) {
        if touch.belief.len() != n_values {
            return Err(wrong(format!(
                "touch {n}: expected a belief of {n_values} places, got {}",
                touch.belief.len()
            )));
        }
    }
    Ok(())
}

/// Text that HTML shows as it is.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A number with so many decimals; a dash where there is none.
pub(crate) fn number(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}").replace('-', "−") } else { "–".into() }
}

/// A difference: like [`number`], with its sign.
pub(crate) fn signed(value: f64, decimals: usize) -> String {
    let number = number(value, decimals);
    let is_nought = number.trim_start_matches('−').chars().all(|c| matches!(c, '0' | '.'));
    match (is_nought, value > 0.0 && value.is_finite()) {
        (true, _) => number.trim_start_matches('−').into(),
        (false, true) => format!("+{number}"),
        (false, false) => number,
    }
}

#[cfg(test)]
mod tests {
    use super::super::result::{self, Choice, Comparison, Inference, ReliabilityBin, Stops};
    use super::*;
    use tactile_data::frame::{Background, Preprocessing};
    use tactile_filter::action::{Action, Expected, Judged};

    fn board() -> Board {
        let square = vec![[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]];
        let part = |name: &str| PartPicture { name: name.into(), outline_mm: vec![square.clone()] };
        Board { parts: vec![part("A<B"), part("C")], grid: PoseGrid::SMALL, field_of_view_mm: [17.0, 13.0] }
    }

    fn next() -> NextTouch {
        let judged = |x, score| Judged { sensor_from_next: Se2::from_degrees(x, 0.0, 0.0), score, by_all_draws: true };
        let judged = vec![judged(4.0, Some(0.75)), judged(-4.0, None)];
        let action = Action { sensor_from_next: judged[0].sensor_from_next };
        let expected = Some(Expected { nats: 0.75, part_nats: 0.5, pair: Some(([1, 0], 0.5)) });
        let judgement = Judgement { action, judged, expected };
        NextTouch { rule: ActionRule::Information, n_candidates: 3, judgement }
    }

    fn episode() -> EpisodeStory {
        let frame = Frame::new(16, 12, (0..3 * 16 * 12).map(|i| 60 + (i / 6) as u8).collect()).unwrap();
        let background = Background::new(&frame, &Preprocessing::counts([8, 6])).unwrap();
        let touch = TouchStory {
            part_from_sensor: Se2::from_degrees(4.0, 0.0, 30.0),
            difference: background.tactile_image(&frame).unwrap(),
            frame,
            guess: 1,
            probability: 0.5,
            fit: Some(-0.75),
            guess_from_sensor: Se2::from_degrees(0.0, 4.0, 0.0),
            fit_needed: Some(-0.25),
            belief: vec![1.0 / 50.0; 50],
            next: Some(next()),
        };
        let touches = vec![touch.clone(), TouchStory { fit: None, next: None, ..touch }];
        EpisodeStory {
            name: "episode 3".into(),
            why: "as one of the first".into(),
            truth: 0,
            stop: "limit".into(),
            refused: false,
            touches,
        }
    }

    fn published() -> Evaluation {
        serde_json::from_value(result::tests::published()).unwrap()
    }

    /// Two rules that stopped, were compared and were now and then sure.
    fn whole() -> Evaluation {
        let (inference, action) = (Inference::Exact, Choice::Information);
        let stops = Stops {
            inference,
            action,
            mean_touches: 3.5,
            confident: 0.75,
            confident_and_wrong: 0.015,
            none_of_these: 0.125,
            touches_to_95: 3.75,
        };
        let comparison = |n_touches| Comparison {
            inference,
            action,
            against: Choice::Random,
            n_touches,
            difference: 0.25,
            ci95: [0.125, 0.375],
        };
        let (probability, right_ci95) = ([0.99, 1.0], [0.95, 0.995]);
        let bin = ReliabilityBin { probability, mean_probability: 0.998, right: 0.98, right_ci95, n: 300 };
        let mut evaluation = published();
        evaluation.stops = vec![stops, Stops { action: Choice::Random, ..stops }];
        evaluation.comparisons = (1..=3).map(comparison).collect();
        evaluation.reliability = vec![bin];
        evaluation.rows[0].xy_mm_median = Some(0.0625);
        evaluation.rows[0].theta_deg_median = Some(0.375);
        evaluation
    }

    fn write(board: &Board, episodes: &[EpisodeStory]) -> io::Result<String> {
        write_evaluation(&whole(), board, episodes)
    }

    fn write_evaluation(evaluation: &Evaluation, board: &Board, episodes: &[EpisodeStory]) -> io::Result<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        write_report(&path, evaluation, board, episodes, &PaperNumbers::of_scene("alphabet-small"))?;
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "nothing is left beside the report");
        fs::read_to_string(&path)
    }

    #[test]
    fn the_report_is_one_page_that_needs_nothing_else() {
        let html = write(&board(), &[episode()]).unwrap();
        for outside in ["http:", "https:", "<script ", "<link", "@import", "import(", "fetch(", "src=\"/"] {
            assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
        }
        assert_eq!(html.matches("<script>").count(), 2, "the one that sorts tables and the viewer");
        assert_eq!(write(&board(), &[]).unwrap().matches("<script>").count(), 1);
        assert!(html.contains("A&lt;B") && !html.contains("A<B"));
    }

    #[test]
    fn each_tag_that_opens_closes() {
        let html = write(&board(), &[episode()]).unwrap();
        let tags = ["table", "tr", "td", "th", "svg", "g", "figure", "figcaption", "section", "div", "p", "text"];
        for tag in tags.into_iter().chain(["ul", "ol", "li", "h2", "h3", "a", "nav", "button", "script", "b", "small"])
        {
            let open = html.matches(&format!("<{tag} ")).count() + html.matches(&format!("<{tag}>")).count();
            assert_eq!(open, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }

    #[test]
    fn the_measured_and_the_papers_numbers_stand_in_the_page() {
        let html = write(&board(), &[]).unwrap();
        assert!(html.contains("90.0") && html.contains("87.0–92.0"), "accuracy at three touches and its interval");
        assert!(html.contains("81.8"), "the paper's accuracy at three touches");
    }

    #[test]
    fn the_key_figures_stand_on_top() {
        let html = write(&board(), &[]).unwrap();
        let tiles = &html[html.find(r#"<div class="tiles">"#).unwrap()..html.find("<figure>").unwrap()];
        // Encoding 5, updating 0.5 and choosing 3 ms: 8.5.
        for figure in ["<b>90.0&nbsp;%</b>", "<b>1.5&nbsp;%</b>", "<b>0.06 mm · 0.4°</b>", "<b>8.5&nbsp;ms</b>"] {
            assert!(tiles.contains(figure), "{figure} in {tiles}");
        }
    }

    #[test]
    fn a_mean_stands_with_its_median() {
        let html = write(&board(), &[]).unwrap();
        assert!(html.contains("0.20<small>median 0.06</small>") && html.contains("0.9<small>median 0.4</small>"));
        let without = write_evaluation(&published(), &board(), &[]).unwrap();
        assert!(without.contains("<td>0.20</td>") && !without.contains("<small>median"));
    }

    #[test]
    fn an_older_evaluation_is_told_without_what_it_does_not_have() {
        let html = write_evaluation(&published(), &board(), &[]).unwrap();
        assert!(!html.contains("as often as it says") && !html.contains("Does choosing"));
        assert!(html.contains("after 2.5 touches on average"));
    }

    #[test]
    fn without_the_parts_in_the_bank_there_is_no_accuracy_to_show() {
        let evaluation = Evaluation { absent: true, ..whole() };
        let html = write_evaluation(&evaluation, &board(), &[]).unwrap();
        assert!(html.contains("taken out of the bank") && html.contains("<b>12.5&nbsp;%</b>"));
        for gone in ["Accuracy and error", "All numbers", "Does choosing", "as often as it says", "the paper: "] {
            assert!(!html.contains(gone), "{gone}");
        }
    }

    #[test]
    fn an_episode_tells_its_fit_touch_by_touch_and_how_it_ended() {
        let html = write(&board(), &[episode()]).unwrap();
        assert!(html.contains("fit −0.75") && html.contains("−0.25 or more") && html.contains("no edge felt"));
        assert!(html.contains("✗ wrong part"));
        let refused = EpisodeStory { refused: true, ..episode() };
        assert!(write(&board(), &[refused]).unwrap().contains("✗ none of these"));
    }

    #[test]
    fn an_episode_tells_why_it_went_on_where_it_did() {
        let html = write(&board(), &[episode()]).unwrap();
        let line = "chosen of 2 candidates: it is expected to tell <b>0.75 nats</b>, most of it (0.50) between <b>C</b> and <b>A&lt;B</b>.";
        assert!(html.contains(line));
        // Believed at (0, 4) on part 1, the chosen candidate leads 4 mm along x; the other would show no edge.
        assert_eq!(html.matches(r#"<circle class="chosen" cx="4.00" cy="4.00""#).count(), 1);
        assert_eq!(html.matches(r#"<circle class="blank" cx="-4.0" cy="4.0""#).count(), 1);
        assert!(html.contains("It stopped: limit."));
    }

    #[test]
    fn each_episode_can_be_picked_by_what_it_is_about() {
        let other = EpisodeStory { name: "episode 8".into(), truth: 1, ..episode() };
        let html = write(&board(), &[episode(), other]).unwrap();
        for (name, truth, verdict) in [("episode-3", "A&lt;B", "✗ wrong part"), ("episode-8", "C", "✓ right part")]
        {
            assert_eq!(html.matches(&format!("<section class=\"episode\" id=\"{name}\">")).count(), 1);
            let entry = html.split(&format!("<li><a href=\"#{name}\">")).nth(1).unwrap();
            let entry = &entry[..entry.find("</a>").unwrap()];
            assert!(entry.contains(&format!("<b>{truth}</b>")) && entry.contains(verdict), "{entry}");
        }
    }

    #[test]
    fn the_first_screen_says_that_boards_are_simulated() {
        let html = write(&board(), &[]).unwrap();
        let top = &html[..html.find(r#"<nav class="contents""#).unwrap()];
        assert!(top.contains("All of it is simulated") && top.contains("No real hole, peg or letter"));
    }

    #[test]
    fn a_difference_has_a_sign_unless_it_is_nought() {
        let signs = [0.26, -0.26, 0.01, -0.01, f64::NAN].map(|value| signed(value, 1));
        assert_eq!(signs, ["+0.3", "−0.3", "0.0", "0.0", "–"]);
    }

    #[test]
    fn a_story_of_another_board_is_refused() {
        let mut short = episode();
        short.touches[1].belief.pop();
        let error = write(&board(), &[short]).unwrap_err();
        assert_eq!(error.to_string(), "episode 3: touch 2: expected a belief of 50 places, got 49");
        let mut unknown = episode();
        unknown.touches[0].guess = 2;
        assert!(write(&board(), &[unknown]).unwrap_err().to_string().contains("one of 2 parts, got part 2"));
    }
}
