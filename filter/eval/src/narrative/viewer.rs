//! A section of episodes, one touch at a time. Without its script, or printed, every touch of every episode is shown.

use maud::{Markup, html};

use super::{Board, Narrative, rows};
use crate::error::Result;
use crate::page::numbers::touch_count;
use crate::page::shell::{Section, anchor, figure};

/// A section of episodes under an entry of the contents and a heading; nothing where there are none.
///
/// # Errors
/// An episode that does not fit the board, or a frame that cannot be drawn.
pub fn section([short, title]: [&str; 2], board: &Board, episodes: &[Narrative]) -> Result<Option<Section>> {
    if episodes.is_empty() {
        return Ok(None);
    }
    episodes.iter().try_for_each(|episode| episode.check(board))?;
    let shown = episodes.iter().map(|episode| rows::section(episode, board)).collect::<Result<Vec<_>>>()?;
    let body = html! {
        (rows::outlines(board))
        div.narratives {
            p.how hidden {
                "Pick an episode and go through its touches with the buttons, the slider or the arrow keys ← and →: where it "
                "touched, what it felt, what it then believed, and why it touched next where it did."
            }
            ol.picker { @for episode in episodes { (link(episode, board)) } }
            div.controls hidden {
                button.back type="button" { "← Previous" }
                input.slider type="range" min="1" value="1" aria-label="Touch";
                button.on type="button" { "Next →" }
                output.which {}
                button.all type="button" {}
            }
            div.stage {
                div.bars { p { "Probability of each part; red is the truth" } }
                div { @for episode in &shown { (episode) } }
            }
        }
        (figure("", caption()))
    };
    Ok(Some(Section::new(short, title, body)))
}

/// How to read a touch.
fn caption() -> Markup {
    html! {
        b { "Where it touched:" } " the true part in grey; red, what the sensor covered, the newest filled, with its upper "
        "edge thick. " b { "What the camera saw," } " and " b { "what changed" } " from the sensor at rest, amplified: "
        "grey is no change. " b { "Where next, and why:" } " the most probable part, and on it, red, where the filter "
        "thinks the sensor is. A dot is a place to touch next, the larger and stronger the more its best angle is expected "
        "to inform, on a scale of each touch’s own; a small hollow one is expected to show no edge. Blue: the place chosen "
        "and what the sensor would cover there. A " b { "nat" } " measures information: 0.69 nats are one yes or no. These "
        "are the filter’s own expectations, estimated from states drawn from its belief; dots other than the best few are "
        "rougher estimates from fewer draws. " b { "Where the first touch was:" } " a map for each part; the stronger the "
        "blue, the more probable the place, on one scale for the touch. The number is the part’s whole probability, before "
        "maps are asked. The red ring is the truth: watch the blue gather in it. Above the maps, the part that is named and its "
        "probability, by the maps, too, where there are any; how likely it is " b { "none of these" } " parts, if that was as "
        "likely as not before the first touch; and how often a part that is not in the bank comes to so good a match at any "
        "touch of an episode. To be confident the filter must be sure of the part, and that rate at most the one that was asked for."
    }
}

/// An episode in the list: what it is called, the truth and how it came out.
fn link(episode: &Narrative, board: &Board) -> Markup {
    let (class, verdict) = rows::verdict(episode);
    html! {
        li {
            a href={ "#" (anchor(&episode.name)) } {
                (episode.name) ": " b { (board.parts[episode.truth].name) } " " span class=(class) { (verdict) }
                small { (touch_count(episode.touches.len())) ", " (episode.why) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{board, episode};
    use super::*;
    use maud::Render;

    fn shown(episodes: &[Narrative]) -> String {
        section(["Episodes", "Touch by touch"], &board(), episodes).unwrap().unwrap().render().0
    }

    #[test]
    fn each_touch_has_its_fit_and_each_episode_its_end() {
        assert!(section(["a", "b"], &board(), &[]).unwrap().is_none());
        let html = shown(&[episode()]);
        assert!(
            html.contains("none of these 50.0 %; 12.5 % of strangers match so well") && html.contains("no edge felt")
        );
        assert!(html.contains("✗ wrong part") && html.contains("It stopped: limit."));
        assert!(html.contains("A&lt;B") && !html.contains("A<B"));
        let refused = Narrative { refused: true, ..episode() };
        assert!(shown(&[refused]).contains("✗ none of these"));
    }

    #[test]
    fn each_touch_says_why_the_next_is_where_it_is() {
        let html = shown(&[episode()]);
        let line = "chosen of 2 candidates: it is expected to give <b>0.75 nats</b>, most of it (0.50) between <b>C</b> and <b>A&lt;B</b>.";
        assert!(html.contains(line), "{html}");
        // Believed at (0, 4) on part 1, the chosen candidate leads 4 mm along x; the other would show no edge.
        assert_eq!(html.matches(r#"<circle class="chosen" cx="4.00" cy="4.00""#).count(), 1);
        assert_eq!(html.matches(r#"<circle class="blank" cx="-4.00" cy="4.00""#).count(), 1);
    }

    #[test]
    fn each_episode_can_be_picked_by_what_it_is_about() {
        let other = Narrative { name: "episode 8".into(), truth: 1, ..episode() };
        let html = shown(&[episode(), other]);
        for (name, truth, verdict) in [("episode-3", "A&lt;B", "✗ wrong part"), ("episode-8", "C", "✓ right part")]
        {
            assert_eq!(html.matches(&format!("<section class=\"episode\" id=\"{name}\">")).count(), 1);
            let entry = html.split(&format!("<li><a href=\"#{name}\">")).nth(1).unwrap();
            let entry = &entry[..entry.find("</a>").unwrap()];
            assert!(entry.contains(&format!("<b>{truth}</b>")) && entry.contains(verdict), "{entry}");
        }
    }
}
