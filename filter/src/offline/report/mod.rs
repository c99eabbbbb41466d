//! The evaluation as one HTML file: no network, no script, for a screen or a printer.

pub(super) mod curves;
mod page;
mod paper;
mod picture;
mod series;
mod story;
pub(super) mod style;

use std::fs;
use std::io;
use std::path::Path;

use tactile_data::frame::{Frame, TactileImage};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;

use super::result::Evaluation;
pub use paper::{PaperNumbers, PaperRow};

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
    /// What to call it: its number and seed.
    pub name: String,
    /// The true part, an index into [`Board::parts`].
    pub truth: usize,
    /// The part named at the end, an index into [`Board::parts`].
    pub guess: usize,
    /// Probability of `guess` at the end, 0..=1.
    pub probability: f64,
    /// Why it ended, in a few words.
    pub stop: String,
    /// The touches, in order.
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
    /// Probability of each place of the first touch, summed over the angle; sums to 1.
    ///
    /// `[part, x, y]`, y fastest: the order of [`PoseGrid::pose`] without its angle.
    pub belief: Vec<f64>,
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
    if let Some(part) = [episode.truth, episode.guess].into_iter().find(|part| *part >= n_parts) {
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
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A number with so many decimals; a dash where there is none.
fn number(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { "–".into() }
}

#[cfg(test)]
mod tests {
    use super::super::result;
    use super::*;
    use tactile_data::frame::{Background, Preprocessing};

    fn board() -> Board {
        let square = vec![[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]];
        let part = |name: &str| PartPicture { name: name.into(), outline_mm: vec![square.clone()] };
        Board { parts: vec![part("A<B"), part("C")], grid: PoseGrid::SMALL, field_of_view_mm: [17.0, 13.0] }
    }

    fn episode() -> EpisodeStory {
        let frame = Frame::new(16, 12, (0..3 * 16 * 12).map(|i| 60 + (i / 6) as u8).collect()).unwrap();
        let background = Background::new(&frame, &Preprocessing::counts([8, 6])).unwrap();
        let touch = TouchStory {
            part_from_sensor: Se2::from_degrees(4.0, 0.0, 30.0),
            difference: background.tactile_image(&frame).unwrap(),
            frame,
            belief: vec![1.0 / 50.0; 50],
        };
        let touches = vec![touch.clone(), touch];
        EpisodeStory { name: "episode 3".into(), truth: 0, guess: 1, probability: 0.5, stop: "limit".into(), touches }
    }

    fn write(board: &Board, episodes: &[EpisodeStory]) -> io::Result<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        let evaluation: Evaluation = serde_json::from_value(result::tests::published()).unwrap();
        write_report(&path, &evaluation, board, episodes, &PaperNumbers::of_scene("alphabet-small"))?;
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "nothing is left beside the report");
        fs::read_to_string(&path)
    }

    #[test]
    fn the_report_is_one_page_that_needs_nothing_else() {
        let html = write(&board(), &[episode()]).unwrap();
        for outside in ["http:", "https:", "<script", "<link", "@import", "src=\"/"] {
            assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
        }
        assert!(html.contains("A&lt;B") && !html.contains("A<B"));
    }

    #[test]
    fn each_tag_that_opens_closes() {
        let html = write(&board(), &[episode()]).unwrap();
        for tag in ["table", "tr", "td", "th", "svg", "g", "figure", "figcaption", "section", "div", "p", "text"] {
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
    fn a_story_of_another_board_is_refused() {
        let mut short = episode();
        short.touches[1].belief.pop();
        let error = write(&board(), &[short]).unwrap_err();
        assert_eq!(error.to_string(), "episode 3: touch 2: expected a belief of 50 places, got 49");
        let unknown = EpisodeStory { guess: 2, ..episode() };
        assert!(write(&board(), &[unknown]).unwrap_err().to_string().contains("one of 2 parts, got part 2"));
    }
}
