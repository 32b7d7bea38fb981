//! The raster of a diagram.
//!
//! Everything is laid out in whole cells, so that "does not overlap" is an exact statement and the
//! layout is the same on every machine. Two cells are a lane: transitions run on even columns only,
//! and the odd ones between them stay free for detours and data paths.

/// Width and height of a cell in the units of a [`Scene`](crate::pictures::scene::Scene).
pub const CELL: f32 = 6.0;

/// Cells of a lane.
pub const LANE: i32 = 2;

/// A point of the raster: column and row, in cells. Columns grow to the right, rows downwards.
pub type Spot = [i32; 2];

/// A rectangle with its corners on the raster, in cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Area {
    /// Column of the left edge.
    pub left: i32,
    /// Row of the upper edge.
    pub top: i32,
    /// Column of the right edge.
    pub right: i32,
    /// Row of the lower edge.
    pub bottom: i32,
}

impl Area {
    /// The rectangle with this upper left corner and this size.
    pub const fn new([left, top]: Spot, [width, height]: Spot) -> Self {
        Area {
            left,
            top,
            right: left + width,
            bottom: top + height,
        }
    }

    /// Columns that it spans.
    pub const fn width(&self) -> i32 {
        self.right - self.left
    }

    /// Rows that it spans.
    pub const fn height(&self) -> i32 {
        self.bottom - self.top
    }

    /// The same rectangle elsewhere.
    pub const fn moved(&self, [right, down]: Spot) -> Self {
        Area {
            left: self.left + right,
            top: self.top + down,
            right: self.right + right,
            bottom: self.bottom + down,
        }
    }
}

/// A spot elsewhere.
pub const fn moved(spot: Spot, by: Spot) -> Spot {
    [spot[0] + by[0], spot[1] + by[1]]
}

/// Cells that a length in units of a scene takes.
pub fn cells(length: f32) -> i32 {
    libm::ceilf(length / CELL) as i32
}

/// A place of the raster in units of a scene.
pub fn point([column, row]: Spot) -> [f32; 2] {
    [column as f32 * CELL, row as f32 * CELL]
}
