//! The terminal: taken, drawn on, and given back as it was.

use std::io::{Error, ErrorKind, IsTerminal, Result, stdout};
use std::time::Duration;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::draw::draw;
use super::view::View;

/// How long a view is waited for before the keys are looked at again: a key is answered at once.
const WAIT: Duration = Duration::from_millis(40);

/// What comes next.
pub enum Feed {
    /// A newer view.
    View(Box<View>),
    /// Nothing new.
    Same,
    /// Nothing will come any more; the last view stays until the user leaves.
    Ended,
    /// The program is to end: so does the view.
    Stopped,
}

/// Shows views until the user leaves (q, Esc or ctrl-C) or `next` says that the program is to end. `next` waits for a view at most as long as it is asked to.
///
/// The terminal is given back as it was when this returns, when it panics, and when `next` does.
///
/// # Errors
/// The standard output is no terminal, or the terminal cannot be drawn on.
pub fn run(mut next: impl FnMut(Duration) -> Feed) -> Result<()> {
    if !stdout().is_terminal() {
        return Err(Error::new(ErrorKind::Unsupported, "standard output: expected a terminal, got a file or a pipe"));
    }
    let mut terminal = ratatui::try_init()?;
    let restore = Restore;
    let mut state = State::default();
    let mut has_ended = false;
    loop {
        terminal.draw(|frame| draw(&state.view, state.chosen.as_deref(), frame))?;
        match next(if has_ended { Duration::ZERO } else { WAIT }) {
            Feed::View(view) => state.view = *view,
            Feed::Same => {}
            Feed::Ended => has_ended = true,
            Feed::Stopped => {
                drop(restore);
                return Ok(());
            }
        }
        if has_ended {
            event::poll(WAIT)?;
        }
        while event::poll(Duration::ZERO)? {
            if let Event::Key(key) = event::read()?
                && !state.goes_on_after(&key)
            {
                drop(restore);
                return Ok(());
            }
        }
    }
}

/// Gives the terminal back, after an error too. After a panic ratatui's hook has done so already, before the message: a
/// second time would move the cursor back over it.
struct Restore;

impl Drop for Restore {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            ratatui::restore();
        }
    }
}

/// What is shown now.
#[derive(Default)]
struct State {
    view: View,
    /// The part that the user chose; `None`: the likeliest.
    chosen: Option<String>,
}

impl State {
    /// Does what a key asks for; `false` where it asks to leave.
    fn goes_on_after(&mut self, key: &KeyEvent) -> bool {
        if key.kind == KeyEventKind::Release {
            return true;
        }
        match key.code {
            KeyCode::Char('q') | KeyCode::Esc => return false,
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return false,
            KeyCode::Down | KeyCode::Right => self.choose(1),
            KeyCode::Up | KeyCode::Left => self.choose(-1),
            KeyCode::Home => self.chosen = None,
            _ => {}
        }
        true
    }

    /// The part so many below the one shown; the likeliest, wherever it goes, at the top.
    fn choose(&mut self, below: isize) {
        let parts = &self.view.parts;
        let now = self.chosen.as_ref().and_then(|name| parts.iter().position(|part| part.name == *name));
        let then = now.unwrap_or(0).saturating_add_signed(below).min(parts.len().saturating_sub(1));
        self.chosen = (then > 0).then(|| parts[then].name.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::watch::view::Part;

    fn state(names: &str) -> State {
        let part = |name: char| Part { name: name.into(), probability: 0.1, map: None };
        State { view: View { parts: names.chars().map(part).collect(), ..View::default() }, chosen: None }
    }

    #[test]
    fn arrows_choose_a_part_and_the_top_follows_the_likeliest() {
        let mut state = state("ABC");
        let mut press = |code: KeyCode| {
            assert!(state.goes_on_after(&KeyEvent::from(code)));
            state.chosen.clone().unwrap_or_default()
        };
        let keys =
            [KeyCode::Down, KeyCode::Right, KeyCode::Down, KeyCode::Up, KeyCode::Left, KeyCode::Up, KeyCode::Down];
        assert_eq!(keys.map(&mut press).concat(), "BCCBB");
        assert_eq!(press(KeyCode::Home), "");
    }

    #[test]
    fn a_part_that_is_gone_is_the_likeliest() {
        let mut state = state("ABC");
        state.chosen = Some("X".into());
        state.choose(1);
        assert_eq!(state.chosen.as_deref(), Some("B"));
        state.view.parts.clear();
        state.choose(1);
        assert_eq!(state.chosen, None);
    }

    #[test]
    fn q_escape_and_control_c_leave_and_c_alone_does_not() {
        let mut state = state("A");
        let control_c = KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL);
        let keys = [KeyEvent::from(KeyCode::Char('q')), KeyEvent::from(KeyCode::Esc), control_c];
        assert!(keys.iter().all(|key| !state.goes_on_after(key)));
        assert!(state.goes_on_after(&KeyEvent::from(KeyCode::Char('c'))));
    }
}
