//! An image with zeros around it, so that windows at its edge are read as any others.

/// Where an image is in a padded one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// Rows of the padded image, and the values of each.
    pub size: [usize; 2],
    /// Rows above the image, and values to its left.
    pub before: [usize; 2],
    /// Rows of the image, and the values of each.
    pub image: [usize; 2],
}

impl Layout {
    /// Values of a padded image.
    pub fn len(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Copies an image to its place.
    pub fn copy(&self, image: &[f32], padded: &mut [f32]) {
        let row = self.image[1];
        for (y, values) in image.chunks_exact(row).enumerate() {
            padded[(self.before[0] + y) * self.size[1] + self.before[1]..][..row].copy_from_slice(values);
        }
    }
}

/// A padded image; the zeros are written anew where the next one has another layout.
#[derive(Debug, Default)]
pub struct Padded {
    values: Vec<f32>,
    layout: Layout,
}

impl Padded {
    /// An image, padded.
    pub fn of(&mut self, image: &[f32], layout: Layout) -> &[f32] {
        if self.layout != layout {
            self.values.clear();
            self.values.resize(layout.len(), 0.0);
            self.layout = layout;
        }
        layout.copy(image, &mut self.values);
        &self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_are_around_each_image_wherever_the_one_before_lay() {
        let mut padded = Padded::default();
        let layout = |rows, before| Layout { size: [3, 4], before, image: [rows, 2] };
        let four = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(padded.of(&four, layout(2, [1, 1])), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 3.0, 4.0, 0.0]);
        assert_eq!(padded.of(&four, layout(2, [0, 2])), [0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(padded.of(&four[2..], layout(1, [0, 2]))[..8], [0.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0]);
    }
}
