//! The numbers at which a smooth function is least (L-BFGS).

use std::sync::{Mutex, PoisonError};

use argmin::core::{CostFunction, Error, Executor, Gradient, State};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

/// Pairs of steps and differences that the search remembers.
const MEMORY: usize = 10;

/// The numbers of least value, and that value, from a start and after so many rounds at most; `function` gives value and derivative at
/// once.
///
/// # Errors
/// Why the search ended without any.
pub fn minimum(
    start: Vec<f64>,
    max_rounds: u64,
    function: impl Fn(&[f64]) -> (f64, Vec<f64>),
) -> Result<(Vec<f64>, f64), String> {
    let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY);
    let found = Executor::new(Problem { function, last: Mutex::new(None) }, solver)
        .configure(|state| state.param(start).max_iters(max_rounds))
        .run()
        .map_err(|error| error.to_string())?;
    let numbers = found.state().get_best_param().ok_or("no numbers")?;
    Ok((numbers.clone(), found.state().get_best_cost()))
}

/// The function as the search asks for it: value and derivative at the same numbers, one after the other.
struct Problem<F> {
    function: F,
    last: Mutex<Option<Known>>,
}

/// Numbers that were asked about, with the value and the derivative there.
struct Known {
    numbers: Vec<f64>,
    value: f64,
    derivative: Vec<f64>,
}

impl<F: Fn(&[f64]) -> (f64, Vec<f64>)> Problem<F> {
    fn at(&self, numbers: &[f64]) -> (f64, Vec<f64>) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        match &*last {
            Some(Known { numbers: known, value, derivative }) if known == numbers => (*value, derivative.clone()),
            _ => {
                let (value, derivative) = (self.function)(numbers);
                *last = Some(Known { numbers: numbers.to_vec(), value, derivative: derivative.clone() });
                (value, derivative)
            }
        }
    }
}

impl<F: Fn(&[f64]) -> (f64, Vec<f64>)> CostFunction for Problem<F> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, numbers: &Self::Param) -> Result<f64, Error> {
        Ok(self.at(numbers).0)
    }
}

impl<F: Fn(&[f64]) -> (f64, Vec<f64>)> Gradient for Problem<F> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, numbers: &Self::Param) -> Result<Vec<f64>, Error> {
        Ok(self.at(numbers).1)
    }
}
