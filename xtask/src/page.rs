//! A page that needs no other file.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// The page: its title, what it claims with a word before it, and what follows.
pub fn page(title: &str, [what, scope]: [&str; 2], body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body {
                h1 { (title) }
                p.scope { b { (what) } " " (scope) }
                (body)
            }
        }
    };
    page.into_string()
}
