//! The lights under which presses are named.

/// The light that pictures are taken to be under, and the bank.
pub enum Light {
    /// That fitted to presses of a ball, both.
    Ball,
    /// The one that the model knows, both.
    Model,
    /// The pictures that of a file, told by touches alone; the bank the model's.
    Touches(String),
    /// The same of touches that are to be labelled.
    Labelling(String),
    /// A file's, told by touches and what the filter takes them for, both.
    Named(String),
}

impl Light {
    /// What it adds to names of what is made under it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Ball => "",
            Self::Model => "-as-it-comes",
            Self::Touches(_) => "-by-touches",
            Self::Labelling(_) => "-labelling",
            Self::Named(_) => "-by-parts",
        }
    }

    /// The calibrations of the bank and of the pictures, each where it is not the model's light. `ball`: that of the ball.
    pub fn files<'a>(&'a self, ball: &'a str) -> [Option<&'a str>; 2] {
        match self {
            Self::Ball => [Some(ball); 2],
            Self::Model => [None; 2],
            Self::Touches(file) | Self::Labelling(file) => [None, Some(file)],
            Self::Named(file) => [Some(file); 2],
        }
    }
}
