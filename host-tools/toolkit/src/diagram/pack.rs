//! Regions side by side and one below the other, so that a container fits a page.
//!
//! A container is cut into bands, a band into stacks, a stack into regions, always from edge to
//! edge, and always in the order of the source. Several widths of bands are tried, lying and
//! standing; the arrangement that a page shows largest is taken.

use super::grid::{Area, Spot};

/// Width of a page divided by its height (A4, ISO 216), either way up.
const PAGE: f64 = std::f64::consts::SQRT_2;
/// How much smaller an upright page may show a container before a lying one is preferred.
const UPRIGHT: f64 = 1.15;
/// Band widths tried.
const TRIALS: i32 = 40;

/// Where regions stand.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Packing {
    /// For each region the part of the container that is its own; together they cover it.
    pub parts: Vec<Area>,
    /// Lines between parts: start and end, downwards or to the right.
    pub dividers: Vec<[Spot; 2]>,
    /// Width and height.
    pub size: Spot,
}

/// Regions of a band, each stack a range.
struct Band {
    stacks: Vec<std::ops::Range<usize>>,
}

/// Arranges regions of these sizes within at least `least` cells.
pub fn pack(sizes: &[Spot], least: Spot) -> Packing {
    let turned: Vec<Spot> = sizes
        .iter()
        .map(|[width, height]| [*height, *width])
        .collect();
    let lying = trials(sizes).map(|length| (false, bands(sizes, length)));
    let standing = trials(&turned).map(|length| (true, bands(&turned, length)));
    let best = lying
        .chain(standing)
        .map(|(is_turned, bands)| {
            let oriented = if is_turned { &turned } else { sizes };
            let [along, across] = extent(oriented, &bands);
            let [width, height] = if is_turned {
                [across, along]
            } else {
                [along, across]
            };
            let (width, height) = (
                f64::from(width.max(least[0])),
                f64::from(height.max(least[1])),
            );
            // The short side of the page that it needs, whichever way up. Pages that lie fit
            // screens and books better.
            let cost = (width / PAGE)
                .max(height)
                .min(UPRIGHT * width.max(height / PAGE));
            (cost, is_turned, bands)
        })
        .min_by(|one, other| one.0.total_cmp(&other.0));
    let Some((_, is_turned, bands)) = best else {
        return Packing {
            size: least,
            ..Packing::default()
        };
    };
    if is_turned {
        let packing = stretch(&turned, &bands, [least[1], least[0]]);
        let flip = |[column, row]: Spot| [row, column];
        Packing {
            parts: packing
                .parts
                .iter()
                .map(|part| Area {
                    left: part.top,
                    top: part.left,
                    right: part.bottom,
                    bottom: part.right,
                })
                .collect(),
            dividers: packing
                .dividers
                .iter()
                .map(|[start, end]| [flip(*start), flip(*end)])
                .collect(),
            size: flip(packing.size),
        }
    } else {
        stretch(sizes, &bands, least)
    }
}

/// Lengths of bands to be tried, each once.
fn trials(sizes: &[Spot]) -> impl Iterator<Item = i32> + use<> {
    let widest = sizes.iter().map(|size| size[0]).max().unwrap_or(0);
    let all: i32 = sizes.iter().map(|size| size[0]).sum();
    let steps = if widest == all { 0 } else { TRIALS };
    (0..=steps).map(move |step| widest + (all - widest) / steps.max(1) * step)
}

/// Fills bands of at most `length`.
fn bands(sizes: &[Spot], length: i32) -> Vec<Band> {
    let mut bands: Vec<Band> = Vec::new();
    // Of the band at work: its length without the last stack, its depth, and the last stack's
    // length and depth.
    let (mut before, mut depth, mut stack) = (0, 0, [0, 0]);
    for (region, [width, height]) in sizes.iter().enumerate() {
        if let Some(stacks) = bands.last_mut().map(|band| &mut band.stacks) {
            let joins = stack[1] + height <= depth && before + stack[0].max(*width) <= length;
            if let Some(last) = stacks.last_mut().filter(|_| joins) {
                last.end = region + 1;
                stack = [stack[0].max(*width), stack[1] + height];
                continue;
            }
            if before + stack[0] + width <= length {
                stacks.push(region..region + 1);
                before += stack[0];
                stack = [*width, *height];
                depth = depth.max(*height);
                continue;
            }
        }
        let first = region..region + 1;
        bands.push(Band {
            stacks: vec![first],
        });
        (before, depth, stack) = (0, *height, [*width, *height]);
    }
    bands
}

fn stack_extent(sizes: &[Spot], stack: &std::ops::Range<usize>) -> Spot {
    sizes[stack.clone()]
        .iter()
        .fold([0, 0], |[wide, high], [width, height]| {
            [wide.max(*width), high + height]
        })
}

fn band_extent(sizes: &[Spot], band: &Band) -> Spot {
    band.stacks
        .iter()
        .map(|stack| stack_extent(sizes, stack))
        .fold([0, 0], |[wide, high], [width, height]| {
            [wide + width, high.max(height)]
        })
}

fn extent(sizes: &[Spot], bands: &[Band]) -> Spot {
    bands
        .iter()
        .map(|band| band_extent(sizes, band))
        .fold([0, 0], |[wide, high], [width, height]| {
            [wide.max(width), high + height]
        })
}

/// Shares `room` among `parts` of these sizes: what is left over goes to all alike. Gives the ends
/// of the parts.
fn shares(parts: &[i32], room: i32) -> Vec<i32> {
    let rest = (room - parts.iter().sum::<i32>()).max(0);
    let count = (parts.len() as i32).max(1);
    let mut end = 0;
    (1..)
        .zip(parts)
        .map(|(index, part)| {
            end += part;
            end + rest * index / count
        })
        .collect()
}

/// Places the regions, and lets them fill their bands and the container.
fn stretch(sizes: &[Spot], bands: &[Band], least: Spot) -> Packing {
    let [along, across] = extent(sizes, bands);
    let size = [along.max(least[0]), across.max(least[1])];
    let mut packing = Packing {
        parts: vec![Area::default(); sizes.len()],
        dividers: Vec::new(),
        size,
    };
    let depths: Vec<i32> = bands
        .iter()
        .map(|band| band_extent(sizes, band)[1])
        .collect();
    let mut top = 0;
    for (band, bottom) in bands.iter().zip(shares(&depths, size[1])) {
        if top > 0 {
            packing.dividers.push([[0, top], [size[0], top]]);
        }
        let widths: Vec<i32> = band
            .stacks
            .iter()
            .map(|stack| stack_extent(sizes, stack)[0])
            .collect();
        let mut left = 0;
        for (stack, right) in band.stacks.iter().zip(shares(&widths, size[0])) {
            if left > 0 {
                packing.dividers.push([[left, top], [left, bottom]]);
            }
            let heights: Vec<i32> = sizes[stack.clone()].iter().map(|size| size[1]).collect();
            let mut upper = top;
            for (region, end) in stack.clone().zip(shares(&heights, bottom - top)) {
                let lower = top + end;
                if upper > top {
                    packing.dividers.push([[left, upper], [right, upper]]);
                }
                packing.parts[region] = Area {
                    left,
                    top: upper,
                    right,
                    bottom: lower,
                };
                upper = lower;
            }
            left = right;
        }
        top = bottom;
    }
    packing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_the_container_and_none_is_too_small() {
        let cases: [&[Spot]; 6] = [
            &[],
            &[[10, 5]],
            &[[10, 5], [10, 5], [10, 5], [10, 5]],
            &[[100, 80], [20, 10], [20, 10], [20, 10], [20, 60]],
            &[[1, 100], [100, 1], [1, 100], [100, 1]],
            &[[3, 3], [300, 4], [2, 200]],
        ];
        for sizes in cases {
            for least in [[0, 0], [150, 150]] {
                let packing = pack(sizes, least);
                let covered: i64 = packing
                    .parts
                    .iter()
                    .map(|part| i64::from(part.width()) * i64::from(part.height()))
                    .sum();
                if !sizes.is_empty() {
                    assert_eq!(
                        covered,
                        i64::from(packing.size[0]) * i64::from(packing.size[1]),
                        "{sizes:?}"
                    );
                }
                for (part, [width, height]) in packing.parts.iter().zip(sizes) {
                    assert!(
                        part.width() >= *width && part.height() >= *height,
                        "{sizes:?}"
                    );
                }
                assert_eq!(packing.dividers.len() + 1, sizes.len().max(1));
            }
        }
    }

    #[test]
    fn small_regions_stand_beside_a_large_one() {
        let packing = pack(&[[100, 80], [30, 20], [30, 20], [30, 20]], [0, 0]);
        assert_eq!(packing.size, [130, 80]);
    }
}
