//! Winograd's linear maps along one axis of a window: weights, inputs and outputs, forward and back.
//!
//! Three taps over `m` outputs are a product of polynomials, found from its values at `m + 1` points and at infinity:
//! `m + 2` products instead of `3 m` (Toom and Cook; Lavin and Gray 2016, Sec. 4). `B^T d` evaluates the inputs, `G g`
//! the weights, `A^T` makes outputs of the products. More outputs save more products and round more coarsely.

use pulp::Simd;

/// Products of the longest window.
pub const MOST: usize = 7;

/// The vectors of one line of a window; those behind its products are not used.
pub type Line<S> = [<S as Simd>::f32s; MOST];

type Matrix = [[f64; MOST]; MOST];

/// How many outputs a window has along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Two, by four products.
    Two,
    /// Four, by six.
    Four,
    /// Five, by seven.
    Five,
}

impl Axis {
    /// The windows that cover `length` outputs by the fewest products; of equals the windows that round less.
    pub fn covering(length: usize) -> Self {
        let products = |axis: &Self| axis.count(length) * axis.products();
        [Self::Two, Self::Four, Self::Five].into_iter().min_by_key(products).unwrap_or(Self::Two)
    }

    /// Windows that cover `length` outputs.
    pub fn count(self, length: usize) -> usize {
        length.div_ceil(self.outputs())
    }

    /// Outputs of a window.
    pub const fn outputs(self) -> usize {
        self.products() - 2
    }

    /// Weights: the side of a kernel.
    const fn taps(self) -> usize {
        3
    }

    /// Products of a window, and its inputs.
    pub const fn products(self) -> usize {
        self.points().len() + 1
    }

    /// Where the polynomials are evaluated, but for infinity. Chosen for the least rounding, on random numbers.
    const fn points(self) -> &'static [f64] {
        match self {
            Self::Two => &[0.0, 1.0, -1.0],
            Self::Four => &[0.0, 0.75, -0.75, 1.5, -1.5],
            Self::Five => &[0.0, 1.0, -1.0, 0.5, -0.5, 2.0],
        }
    }

    /// `G`, `[products, 3]`: the weights at each point, divided by its distances from the others.
    const fn of_weights(self) -> Matrix {
        let points = self.points();
        let mut matrix = [[0.0; MOST]; MOST];
        let mut k = 0;
        while k < points.len() {
            let (mut value, mut other) = (1.0, 0);
            while other < points.len() {
                if other != k {
                    value /= points[k] - points[other];
                }
                other += 1;
            }
            matrix[k] = [value, value * points[k], value * points[k] * points[k], 0.0, 0.0, 0.0, 0.0];
            k += 1;
        }
        matrix[points.len()][2] = 1.0;
        matrix
    }

    /// `B^T`, `[products, inputs]`: coefficients of the polynomial that is zero at all points but one; at all for infinity.
    const fn of_inputs(self) -> Matrix {
        let points = self.points();
        let mut matrix = [[0.0; MOST]; MOST];
        let mut k = 0;
        while k <= points.len() {
            matrix[k][0] = 1.0;
            let (mut degree, mut at) = (0, 0);
            while at < points.len() {
                if at != k {
                    // Times (x - point).
                    degree += 1;
                    let mut power = degree;
                    while power > 0 {
                        matrix[k][power] = matrix[k][power - 1] - points[at] * matrix[k][power];
                        power -= 1;
                    }
                    matrix[k][0] *= -points[at];
                }
                at += 1;
            }
            k += 1;
        }
        matrix
    }

    /// `A^T`, `[outputs, products]`: powers of each point; infinity adds to the last output alone.
    const fn of_outputs(self) -> Matrix {
        let points = self.points();
        let mut matrix = [[0.0; MOST]; MOST];
        let mut k = 0;
        while k < points.len() {
            let (mut value, mut output) = (1.0, 0);
            while output < points.len() - 1 {
                matrix[output][k] = value;
                value *= points[k];
                output += 1;
            }
            k += 1;
        }
        matrix[points.len() - 2][points.len()] = 1.0;
        matrix
    }

    const fn of_outputs_back(self) -> Matrix {
        transposed(self.of_outputs())
    }

    const fn of_weights_back(self) -> Matrix {
        transposed(self.of_weights())
    }
}

/// Vectors of a window, `[rows][columns]`; those behind its sizes are not used.
pub struct Square<S: Simd> {
    /// What is mapped, then what came of it.
    pub values: [Line<S>; MOST],
    between: [Line<S>; MOST],
}

impl<S: Simd> Square<S> {
    /// All zeros.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let zeros = [[simd.splat_f32s(0.0); MOST]; MOST];
        Self { values: zeros, between: zeros }
    }

    /// `T values T^T`: a map along each of the two axes, rows and columns.
    #[inline(always)]
    pub fn map<T: Maps>(&mut self, simd: S, [along_y, along_x]: [Axis; 2]) {
        let ([height, made_height], [_, made_width]) = (T::sizes(along_y), T::sizes(along_x));
        for y in 0..height {
            T::apply(along_x, simd, &self.values[y], &mut self.between[y]);
        }
        let (mut column, mut made) = (self.values[0], self.values[0]);
        for x in 0..made_width {
            for (value, line) in column.iter_mut().zip(&self.between).take(height) {
                *value = line[x];
            }
            T::apply(along_y, simd, &column, &mut made);
            for (line, value) in self.values.iter_mut().zip(&made).take(made_height) {
                line[x] = *value;
            }
        }
    }
}

/// One of the linear maps, for each axis.
pub trait Maps {
    /// Values of a line before and after.
    fn sizes(axis: Axis) -> [usize; 2];

    /// A line of vectors, mapped.
    fn apply<S: Simd>(axis: Axis, simd: S, from: &Line<S>, to: &mut Line<S>);
}

/// A matrix that is known when the program is compiled, so that its zeros cost nothing.
trait Map {
    const ROWS: usize;
    const COLUMNS: usize;
    const MATRIX: Matrix;
}

const fn axis(outputs: usize) -> Axis {
    match outputs {
        2 => Axis::Two,
        4 => Axis::Four,
        _ => Axis::Five,
    }
}

/// A map and its matrix for each axis.
macro_rules! map {
    ($(#[$doc:meta])* $name:ident, $of:ident, $matrix:expr, $rows:ident x $columns:ident) => {
        $(#[$doc])*
        pub struct $name;

        struct $of<const N: usize>;

        impl<const N: usize> Map for $of<N> {
            const ROWS: usize = axis(N).$rows();
            const COLUMNS: usize = axis(N).$columns();
            const MATRIX: Matrix = $matrix(axis(N));
        }

        impl Maps for $name {
            #[inline(always)]
            fn sizes(axis: Axis) -> [usize; 2] {
                [axis.$columns(), axis.$rows()]
            }

            #[inline(always)]
            fn apply<S: Simd>(axis: Axis, simd: S, from: &Line<S>, to: &mut Line<S>) {
                match axis {
                    Axis::Two => apply::<S, $of<2>>(simd, from, to),
                    Axis::Four => apply::<S, $of<4>>(simd, from, to),
                    Axis::Five => apply::<S, $of<5>>(simd, from, to),
                }
            }
        }
    };
}

map! {
    /// `B^T d`: the inputs of a window as its factors.
    Inputs, OfInputs, Axis::of_inputs, products x products
}
map! {
    /// `A^T m`: the products of a window as its outputs.
    Outputs, OfOutputs, Axis::of_outputs, outputs x products
}
map! {
    /// `A y`: the adjoint of [`Outputs`].
    OutputsBack, OfOutputsBack, Axis::of_outputs_back, products x outputs
}
map! {
    /// `G g`: three weights as the factors of a window.
    Weights, OfWeights, Axis::of_weights, products x taps
}
map! {
    /// `G^T u`: the adjoint of [`Weights`].
    WeightsBack, OfWeightsBack, Axis::of_weights_back, taps x products
}

const fn transposed(matrix: Matrix) -> Matrix {
    let mut turned = [[0.0; MOST]; MOST];
    let mut at = 0;
    while at < MOST * MOST {
        turned[at % MOST][at / MOST] = matrix[at / MOST][at % MOST];
        at += 1;
    }
    turned
}

#[inline(always)]
fn apply<S: Simd, T: Map>(simd: S, from: &Line<S>, to: &mut Line<S>) {
    for (to, row) in to.iter_mut().zip(&T::MATRIX).take(T::ROWS) {
        let mut sum = simd.splat_f32s(0.0);
        for (from, factor) in from.iter().zip(row).take(T::COLUMNS) {
            if *factor != 0.0 {
                sum = simd.mul_add_f32s(simd.splat_f32s(*factor as f32), *from, sum);
            }
        }
        *to = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    const ALL: [Axis; 3] = [Axis::Two, Axis::Four, Axis::Five];

    fn line(n: usize, seed: f32) -> Line<Scalar> {
        std::array::from_fn(|i| if i < n { (seed * (i as f32 + 1.0)).sin() } else { 0.0 })
    }

    fn map<T: Maps>(axis: Axis, from: &Line<Scalar>) -> Line<Scalar> {
        let mut to = [0.0; MOST];
        T::apply(axis, Scalar, from, &mut to);
        to
    }

    #[test]
    fn the_products_make_outputs_of_three_taps() {
        for axis in ALL {
            let (weights, inputs) = (line(3, 0.4), line(axis.products(), 0.7));
            let [wide, factors] = [map::<Weights>(axis, &weights), map::<Inputs>(axis, &inputs)];
            let outputs = map::<Outputs>(axis, &std::array::from_fn(|k| wide[k] * factors[k]));
            for (at, output) in outputs[..axis.outputs()].iter().enumerate() {
                let direct: f32 = (0..3).map(|tap| weights[tap] * inputs[at + tap]).sum();
                assert!((output - direct).abs() < 3e-6, "{axis:?} {at}: {output} {direct}");
            }
        }
    }

    #[test]
    fn the_way_back_is_the_adjoint() {
        let dot = |a: &Line<Scalar>, b: &Line<Scalar>| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        for axis in ALL {
            let (u, g, y) = (line(axis.products(), 0.9), line(3, 0.4), line(axis.outputs(), 1.3));
            assert!((dot(&map::<Weights>(axis, &g), &u) - dot(&g, &map::<WeightsBack>(axis, &u))).abs() < 1e-5);
            assert!((dot(&map::<Outputs>(axis, &u), &y) - dot(&u, &map::<OutputsBack>(axis, &y))).abs() < 1e-4);
        }
    }

    #[test]
    fn an_image_is_covered_by_the_fewest_products() {
        assert_eq!(
            [1, 2, 4, 5, 8, 10, 15].map(Axis::covering),
            [Axis::Two, Axis::Two, Axis::Four, Axis::Five, Axis::Four, Axis::Five, Axis::Five]
        );
    }
}
