//! One case: what was tried, what was expected, what came.

use std::fmt;

use crate::Result;

/// What a case drives to its extreme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// How much a distance between touch and view costs.
    Steepness,
    /// Distances, outliers and rarities.
    Odds,
    /// tau, of Alg. 1 as printed.
    Temperature,
    /// K.
    Particles,
    /// Parts in the bank.
    Classes,
    /// Similarities that carry no information or are not numbers.
    Similarity,
    /// Motions one after the other.
    Chain,
    /// Angles round half a turn.
    Wrap,
    /// Touches, of which each may leave states out.
    LeftOut,
    /// Nothing: all defaults, with what users meet.
    Production,
    /// The bits of a bank's rows.
    Precision,
    /// Touches before a choice.
    Choice,
}

impl Group {
    /// All groups, in the order of the table.
    pub const ALL: [Self; 12] = [
        Self::Production,
        Self::Precision,
        Self::Choice,
        Self::Steepness,
        Self::Odds,
        Self::Temperature,
        Self::Particles,
        Self::Classes,
        Self::Similarity,
        Self::Chain,
        Self::Wrap,
        Self::LeftOut,
    ];

    /// What [`Case::at`] counts.
    pub fn axis(self) -> &'static str {
        match self {
            Self::Steepness => "nats a unit of distance",
            Self::Temperature => "temperature",
            Self::Particles => "particles",
            Self::Classes => "parts",
            Self::Odds | Self::Similarity | Self::Precision => "",
            Self::Chain => "actions",
            Self::Wrap => "degrees",
            Self::LeftOut | Self::Production | Self::Choice => "touches",
        }
    }
}

/// What was tried, expected and measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// What it drives to its extreme.
    pub group: Group,
    /// Which of the ways it was tried in.
    pub variant: String,
    /// How far, in units of [`Group::axis`]; `None` where there is nothing to count.
    pub at: Option<f64>,
    /// What should happen, in a few words.
    pub expected: String,
    /// The largest error, relative unless `expected` names a unit; `None` where nothing can be measured.
    pub error: Option<f64>,
    /// The largest error that rounding or chance explains; `None` where it is infinite.
    pub bound: Option<f64>,
    /// Where the bound comes from, in a few words.
    pub source: String,
    /// Whether the bound is above 1, so that it explains any error: the case then shows an error and judges nothing.
    pub says_nothing: bool,
    /// Whether the true part stayed the most probable; `None` where that is not asked.
    pub right_part: Option<bool>,
    /// What the library said where it refused.
    pub refused: Option<String>,
    /// Whether all is as expected.
    pub holds: bool,
}

/// A bound above this says nothing: no probability is farther off, and a relative error of all of it is no agreement.
const MOST_TOLD: f64 = 1.0;

impl Case {
    /// A case whose error is measured; it holds where the error is within `bound`. NaN never is.
    pub fn measured(
        group: Group,
        variant: impl Into<String>,
        expected: impl Into<String>,
        error: f64,
        bound: f64,
    ) -> Self {
        Self {
            group,
            variant: variant.into(),
            at: None,
            expected: expected.into(),
            error: Some(error),
            bound: bound.is_finite().then_some(bound),
            source: String::new(),
            // NaN is no bound either.
            says_nothing: bound.is_nan() || bound > MOST_TOLD,
            right_part: None,
            refused: None,
            holds: error <= bound,
        }
    }

    /// A case that should be refused; it holds where an error came, and not where a value did.
    pub fn refused<T>(group: Group, variant: impl Into<String>, came: Result<T>) -> Self {
        let refused = came.err().map(|error| error.to_string());
        Self {
            group,
            variant: variant.into(),
            at: None,
            expected: "refused in one line".into(),
            error: None,
            bound: None,
            source: String::new(),
            says_nothing: false,
            right_part: None,
            holds: refused.is_some(),
            refused,
        }
    }

    /// The same with where its bound comes from.
    pub fn by(self, source: &str) -> Self {
        Self { source: source.into(), ..self }
    }

    /// The same at one place of its group's axis.
    pub fn at(self, at: f64) -> Self {
        Self { at: Some(at), ..self }
    }

    /// The same where the true part must be the most probable.
    pub fn right_part(self, right: bool) -> Self {
        Self { right_part: Some(right), holds: self.holds && right, ..self }
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { group, variant, at, expected, error, bound, source, .. } = self;
        write!(f, "{group:?}, {variant}")?;
        if let Some(at) = at {
            write!(f, ", {at:e} {}", group.axis())?;
        }
        write!(f, ": expected {expected}; ")?;
        match (&self.refused, error, bound) {
            (Some(refused), ..) => write!(f, "refused: {refused}")?,
            (None, Some(error), Some(bound)) => write!(f, "error {error:.1e}, bound {bound:.1e} ({source})")?,
            (None, ..) => write!(f, "error {error:?}, bound {bound:?} ({source})")?,
        }
        if self.says_nothing {
            write!(f, ", which says nothing")?;
        }
        if self.right_part == Some(false) {
            write!(f, ", and another part is the most probable")?;
        }
        write!(f, "{}", if self.holds { "" } else { ": NOT as expected" })
    }
}

mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_never_holds() {
        let holds = |error, bound| Case::measured(Group::Chain, "", "", error, bound).holds;
        assert!(holds(1.0, 1.0) && holds(1e300, f64::INFINITY));
        assert!(!holds(1.1, 1.0) && !holds(f64::NAN, f64::INFINITY));
    }

    #[test]
    fn a_bound_above_one_says_nothing_and_is_no_secret() {
        let says_nothing = |bound| Case::measured(Group::Steepness, "", "", 0.5, bound).says_nothing;
        assert_eq!([1e-9, 1.0, 1.1, f64::INFINITY, f64::NAN].map(says_nothing), [false, false, true, true, true]);
        let case = Case::measured(Group::Steepness, "", "", 0.5, 3.0).by("rounding");
        assert!(case.holds && case.source == "rounding");
    }

    #[test]
    fn an_expected_refusal_that_does_not_come_fails() {
        assert!(!Case::refused(Group::Similarity, "", Ok(1)).holds);
        let came = Case::refused::<()>(Group::Similarity, "", Err("a touch".into()));
        assert!(came.holds && came.refused.as_deref() == Some("a touch"));
    }

    #[test]
    fn a_lost_part_fails_however_small_the_error() {
        let case = Case::measured(Group::Classes, "", "", 0.0, 1.0);
        assert!(case.clone().right_part(true).holds && !case.right_part(false).holds);
    }
}
