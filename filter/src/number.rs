//! Numbers in tables: each declared once, with its name, unit, range, default and reason.
//!
//! A table makes the struct that holds the numbers, its defaults, its check, and reading and writing by name.

use std::fmt;
use std::ops::RangeInclusive;

use tactile_data::text::printable::printable;
use tactile_infer::calibration::own_by_edge::MOST_BY_EDGE;
use tactile_infer::maps::sensor_offset::{MOST_MISFIT, MOST_STRAIN};

use crate::error::{Error, Result};

/// What a number comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The user chooses it.
    Chosen,
    /// Measured: a calibration or a bank has it.
    Measured,
    /// Fixed, for the reason that its source gives.
    Fixed,
}

/// A number of a table `T`.
pub struct Number<T> {
    /// The name of its field.
    pub name: &'static str,
    /// Its unit; empty where it has none.
    pub unit: &'static str,
    /// What it may be.
    pub range: Range,
    /// What it comes from.
    pub kind: Kind,
    /// What it does, in Markdown.
    pub doc: &'static str,
    /// Where its value is from, and on which parts it was chosen.
    pub source: &'static str,
    /// What goes wrong without it.
    pub without: &'static str,
    /// As text: `none` where it is none; else the shortest that reads back to the same bits.
    pub(crate) get: fn(&T) -> String,
    /// From such a text; `false` where it cannot be read.
    pub(crate) set: fn(&mut T, &str) -> bool,
    /// As a number, where it is one.
    pub(crate) number: fn(&T) -> Option<f64>,
    /// What may be read, in words.
    pub(crate) words: &'static str,
    /// Whether it may be none.
    pub is_optional: bool,
    /// Whether it is a whole number.
    pub is_whole: bool,
}

impl<T> Number<T> {
    /// Reads a text into the number. `place`: what the table's numbers are called in an error.
    pub(crate) fn write_to(&self, table: &mut T, place: &str, text: &str) -> Result<()> {
        if !(self.set)(table, text) {
            return Err(self.refused(place, self.words, text));
        }
        self.check(table, place)
    }

    /// Refuses a number outside its range.
    pub(crate) fn check(&self, table: &T, place: &str) -> Result<()> {
        match (self.number)(table) {
            Some(value) if !self.range.contains(value) => {
                Err(self.refused(place, &self.range.to_string(), &self.text(table)))
            }
            _ => Ok(()),
        }
    }

    fn refused(&self, place: &str, expected: &str, got: &str) -> Error {
        Error::config(format!("{place}.{}", self.name), self.or_none(expected), printable(got))
    }

    fn or_none(&self, words: &str) -> String {
        format!("{words}{}", if self.is_optional { ", or none" } else { "" })
    }

    /// What it may be, in words: its range, or none where it may be none.
    pub fn allowed(&self) -> String {
        self.or_none(&self.range.to_string())
    }

    /// Its value in a table, as text: the shortest that reads back to the same bits, or `none`.
    pub fn text(&self, table: &T) -> String {
        (self.get)(table)
    }

    /// Its row of a table in Markdown: name, unit, range, default, what it does.
    #[cfg(test)]
    pub(crate) fn row(&self, defaults: &T) -> String {
        let Self { name, unit, doc, .. } = self;
        format!("| `{name}` | {unit} | {} | {} | {} |", self.allowed(), self.text(defaults), doc.trim())
    }
}

/// The number of a table that has a name.
pub(crate) fn find<T>(numbers: &'static [Number<T>], place: &str, name: &str) -> Result<&'static Number<T>> {
    let unknown = || {
        let names: Vec<&str> = numbers.iter().map(|number| number.name).collect();
        Error::config(format!("{place}.{}", printable(name)), format!("one of {}", names.join(", ")), "another name")
    };
    numbers.iter().find(|number| number.name == name).ok_or_else(unknown)
}

/// What a number may be.
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    /// In words; none where the bounds say it.
    words: Option<&'static str>,
    bounds: RangeInclusive<f64>,
    is_open: [bool; 2],
}

impl Range {
    pub(crate) const SHARE: Self = Self::closed("0..=1", 0.0, 1.0);
    pub(crate) const COSINE: Self = Self::closed("-1..=1", -1.0, 1.0);
    pub(crate) const BY_EDGE: Self = Self::within(MOST_BY_EDGE);
    pub(crate) const STRAIN: Self = Self::within(MOST_STRAIN);
    pub(crate) const MISFIT: Self = Self::within(MOST_MISFIT);
    pub(crate) const BELOW_ONE: Self = Self { is_open: [false, true], ..Self::closed("0 to below 1", 0.0, 1.0) };
    pub(crate) const POSITIVE: Self =
        Self { is_open: [true, false], ..Self::closed("a positive number", 0.0, f64::MAX) };
    pub(crate) const DISTANCE: Self = Self { is_open: [true, false], ..Self::closed("above 0, at most 2", 0.0, 2.0) };
    pub(crate) const NOT_NEGATIVE: Self = Self::closed("a number, not negative", 0.0, f64::MAX);
    pub(crate) const COUNT: Self = Self::closed("at least 1", 1.0, f64::MAX);
    pub(crate) const ANY: Self = Self::closed("any", f64::MIN, f64::MAX);

    const fn closed(words: &'static str, least: f64, most: f64) -> Self {
        Self { words: Some(words), bounds: least..=most, is_open: [false; 2] }
    }

    /// At most so far from 0.
    const fn within(most: f64) -> Self {
        Self { words: None, bounds: -most..=most, is_open: [false; 2] }
    }

    /// From 1 to a number.
    pub(crate) const fn up_to(most: f64) -> Self {
        Self { words: None, bounds: 1.0..=most, is_open: [false; 2] }
    }

    /// Whether a number is within.
    pub fn contains(&self, value: f64) -> bool {
        let [opens, closes] = self.is_open;
        let is_bound = opens && value == *self.bounds.start() || closes && value == *self.bounds.end();
        self.bounds.contains(&value) && !is_bound
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.words {
            Some(words) => f.write_str(words),
            None => write!(f, "{} to {}", self.bounds.start(), self.bounds.end()),
        }
    }
}

/// A value of a table, as text.
pub(crate) trait Written: Sized {
    /// What it is, where a text cannot be read.
    const WORDS: &'static str;
    /// Whether it may be none.
    const IS_OPTIONAL: bool = false;
    /// Whether it is a whole number.
    const IS_WHOLE: bool;
    fn read(text: &str) -> Option<Self>;
    fn write(&self) -> String;
    /// As a number, where it is one.
    fn number(&self) -> Option<f64>;
}

macro_rules! written {
    ($($kind:ty: $words:literal, $is_whole:literal);+) => {$(
        impl Written for $kind {
            const WORDS: &'static str = $words;
            const IS_WHOLE: bool = $is_whole;
            fn read(text: &str) -> Option<Self> {
                text.parse().ok()
            }
            fn write(&self) -> String {
                self.to_string()
            }
            fn number(&self) -> Option<f64> {
                Some(*self as f64)
            }
        }
    )+};
}

written!(
    f64: "a number", false;
    f32: "a number", false;
    usize: "a whole number, not negative", true;
    u64: "a whole number, not negative", true
);

impl<T: Written> Written for Option<T> {
    const WORDS: &'static str = T::WORDS;
    const IS_OPTIONAL: bool = true;
    const IS_WHOLE: bool = T::IS_WHOLE;
    fn read(text: &str) -> Option<Self> {
        if text == NONE { Some(None) } else { T::read(text).map(Some) }
    }
    fn write(&self) -> String {
        self.as_ref().map_or_else(|| NONE.into(), T::write)
    }
    fn number(&self) -> Option<f64> {
        self.as_ref().and_then(T::number)
    }
}

/// How none is written.
const NONE: &str = "none";

/// Declares a table of numbers: a struct with its defaults, and a [`Number`] for each. Each line: the name with its type
/// and default; unit; range; where its value is from; what goes wrong without it.
macro_rules! numbers {
    (
        $(#[$about:meta])*
        pub struct $table:ident in $place:literal {
            $($(#[doc = $doc:literal])+
            $name:ident: $kind:ty = $default:expr, $unit:literal, $range:expr, $from:ident: $source:literal; $without:literal;)+
        }
        more { $($(#[$more_about:meta])+ $more:ident: $more_kind:ty = $more_default:expr;)* }
    ) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $table {
            $($(#[doc = $doc])+ pub $name: $kind,)+
            $($(#[$more_about])+ pub $more: $more_kind,)*
        }

        impl Default for $table {
            fn default() -> Self {
                Self { $($name: $default,)+ $($more: $more_default,)* }
            }
        }

        impl $table {
            /// What the numbers are called in an error.
            const PLACE: &'static str = $place;

            const NUMBERS: &'static [$crate::number::Number<Self>] = &[$($crate::number::Number {
                name: stringify!($name),
                unit: $unit,
                range: $range,
                kind: $crate::number::Kind::$from,
                doc: concat!($($doc),+),
                source: $source,
                without: $without,
                get: |table| $crate::number::Written::write(&table.$name),
                set: |table, text| {
                    <$kind as $crate::number::Written>::read(text).map(|read| table.$name = read).is_some()
                },
                number: |table| $crate::number::Written::number(&table.$name),
                words: <$kind as $crate::number::Written>::WORDS,
                is_optional: <$kind as $crate::number::Written>::IS_OPTIONAL,
                is_whole: <$kind as $crate::number::Written>::IS_WHOLE,
            },)+];

            /// The numbers, in order.
            pub fn numbers() -> &'static [$crate::number::Number<Self>] {
                Self::NUMBERS
            }

            /// A number by its name, as text: the shortest that reads back to the same bits, or `none`.
            ///
            /// # Errors
            /// No number has the name.
            pub fn get(&self, name: &str) -> $crate::error::Result<String> {
                $crate::number::find(Self::NUMBERS, Self::PLACE, name).map(|number| number.text(self))
            }

            /// Sets a number by its name, from such a text.
            ///
            /// # Errors
            /// No number has the name, or its range does not have the value. Nothing is changed.
            pub fn set(&mut self, name: &str, text: &str) -> $crate::error::Result<()> {
                let mut changed = *self;
                let number = $crate::number::find(Self::NUMBERS, Self::PLACE, name)?;
                number.write_to(&mut changed, Self::PLACE, text)?;
                *self = changed;
                Ok(())
            }

            /// Refuses the first number outside its range.
            fn check_ranges(&self) -> $crate::error::Result<()> {
                Self::NUMBERS.iter().try_for_each(|number| number.check(self, Self::PLACE))
            }
        }
    };
}

pub(crate) use numbers;
