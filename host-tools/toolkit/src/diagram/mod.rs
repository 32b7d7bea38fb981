//! State diagrams: a machine in the symbols of Merz, Rudol and Wzorek (2006), laid out to be read
//! and printed.
//!
//! ```text
//! Model ─ body ─▶ containers, laid out ─ drawing ─▶ everything at its place ─ paint ─▶ Scene ─▶ SVG, PNG
//! ```
//!
//! From the inside outwards: a region is laid out in layers ([`layered`]), regions are packed into
//! their container ([`pack`]), data paths are led around what stands ([`wires`]), and the container
//! becomes a box in the region that uses it ([`body`]). Everything stands on a raster of whole
//! cells ([`grid`]), so that what a diagram promises can be tested exactly; equal input gives equal
//! bytes.
//!
//! ```
//! use esm_toolkit::diagram::{self, Options};
//!
//! let checked = esm_toolkit::lang::load_text("m.esm", "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\
//!     machine M { region r { state A; state B timeout 1 s; initial -> A; A -> B; B -> A [timeout]; } }");
//! let scene = diagram::draw(checked.model.as_ref().unwrap(), &Options::default()).unwrap();
//! assert!(scene.to_svg().starts_with("<svg"));
//! ```

pub mod body;
pub mod drawing;
pub mod face;
pub mod grid;
pub mod label;
pub mod layered;
mod legend;
mod notes;
mod options;
pub mod pack;
pub mod paint;
pub mod task;
pub mod wires;

#[cfg(test)]
mod laws;

use thiserror::Error;

use crate::model::{Model, StateKind};
use crate::nearest;
use crate::pictures::scene::Scene;

use body::Workshop;
use drawing::Drawing;
use label::Line;
pub use options::Options;
use options::Shown;

/// States that a diagram shows, at most: a container that is used twice counts twice.
pub const MAX_STATES: u64 = 2_000;
/// Transitions that a diagram shows, at most.
pub const MAX_TRANSITIONS: u64 = 6_000;
/// Levels of superstates within superstates that a diagram shows, at most.
pub const MAX_LEVELS: u32 = 64;

/// Why there is no diagram.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DrawError {
    /// There is neither a machine nor a container.
    #[error("there is nothing to draw: the files have neither a machine nor a container")]
    Nothing,
    /// There is no container of that name.
    #[error("there is no container `{name}`{}", .nearest.as_ref().map(|nearest| format!("; did you mean `{nearest}`?")).unwrap_or_default())]
    NoContainer {
        /// The name asked for.
        name: String,
        /// A name that is there and is much like it.
        nearest: Option<String>,
    },
    /// More than [`MAX_STATES`] or [`MAX_TRANSITIONS`].
    #[error(
        "the diagram would show {states} states and {transitions} transitions, and {MAX_STATES} and {MAX_TRANSITIONS} are the most that is drawn: \
         `--depth N` leaves the inside of deeper superstates away, `--container NAME` draws one container alone"
    )]
    TooLarge {
        /// States, each as often as it would be shown.
        states: u64,
        /// Transitions likewise.
        transitions: u64,
    },
    /// More than [`MAX_LEVELS`].
    #[error(
        "superstates are nested {levels} levels deep, and {MAX_LEVELS} are the most that is drawn: `--depth {MAX_LEVELS}` leaves what is deeper away, \
         `--container NAME` draws one container alone"
    )]
    TooDeep {
        /// Levels.
        levels: u32,
    },
    /// A region has so many long transitions that nobody could follow them.
    #[error(
        "a region has too many long transitions to be drawn: its lines would pass more than {} places; `--container NAME` draws another container alone",
        layered::MAX_VERTICES
    )]
    TooTangled,
}

/// Draws a model.
///
/// # Errors
/// If there is nothing to draw, or too much.
pub fn draw(model: &Model, options: &Options) -> Result<Scene, DrawError> {
    let drawing = lay_out(model, options)?;
    let roots = roots(model, options)?;
    let mut scene = paint::paint(&drawing, &title(model, &roots), options.parts);
    if options.notes {
        let levels = options.depth.unwrap_or(MAX_LEVELS);
        notes::add(&mut scene, model, &roots, levels.min(MAX_LEVELS));
    }
    if options.legend {
        legend::add(&mut scene);
    }
    Ok(scene)
}

/// Lays a model out without painting it.
///
/// # Errors
/// As [`draw`].
pub fn lay_out(model: &Model, options: &Options) -> Result<Drawing, DrawError> {
    let roots = roots(model, options)?;
    let extent = Extent::of(model);
    let levels = roots.iter().map(|root| extent.levels[*root]).max();
    let levels = levels.unwrap_or(0).min(options.depth.unwrap_or(u32::MAX));
    // A path has a region and a state for each level.
    let named = options
        .otherwise
        .iter()
        .map(|path| path.split('/').count() / 2);
    let levels_of_named = named
        .max()
        .map_or(0, |levels| u32::try_from(levels).unwrap_or(u32::MAX));
    if levels.max(levels_of_named) > MAX_LEVELS {
        let levels = levels.max(levels_of_named);
        return Err(DrawError::TooDeep { levels });
    }
    let shown = Shown::new(levels, &options.otherwise);
    let (mut states, mut transitions) = (0_u64, 0_u64);
    for root in &roots {
        let of_root = count_shown(model, *root, &shown);
        states = states.saturating_add(of_root.0);
        transitions = transitions.saturating_add(of_root.1);
    }
    if states > MAX_STATES || transitions > MAX_TRANSITIONS {
        return Err(DrawError::TooLarge {
            states,
            transitions,
        });
    }
    let mut workshop = Workshop::new(model, options);
    let mut placed = Vec::with_capacity(roots.len());
    for root in roots {
        let name = heading(model, root);
        let mut widest = grid::cells(name.width(label::NAME));
        for line in face::declarations(model, &model.containers[root]) {
            widest = widest.max(grid::cells(line.width(label::DETAIL)));
        }
        let least = [widest + 2 * face::MARGIN, 0];
        let body = workshop
            .body(root, shown.clone(), least)
            .map_err(|layered::TooTangled| DrawError::TooTangled)?;
        placed.push((name, body));
    }
    Ok(Drawing::of(&placed))
}

fn heading(model: &Model, container: usize) -> Line {
    let container = &model.containers[container];
    let kind = if container.is_machine {
        "machine"
    } else {
        "container"
    };
    Line::words(format!("{kind} {}", label::name(&container.name)))
}

fn title(model: &Model, roots: &[usize]) -> String {
    let names: Vec<String> = roots
        .iter()
        .map(|root| heading(model, *root).to_string())
        .collect();
    names.join(", ")
}

/// The containers that stand on the sheet.
fn roots(model: &Model, options: &Options) -> Result<Vec<usize>, DrawError> {
    if let Some(name) = &options.container {
        let found = model
            .containers
            .iter()
            .position(|container| container.name == *name);
        return match found {
            Some(index) => Ok(vec![index]),
            None => {
                let names = model
                    .containers
                    .iter()
                    .map(|container| container.name.as_str());
                Err(DrawError::NoContainer {
                    name: name.clone(),
                    nearest: nearest::nearest(name, names).map(Into::into),
                })
            }
        };
    }
    match model.machine {
        Some(machine) => Ok(vec![machine]),
        None if model.containers.is_empty() => Err(DrawError::Nothing),
        None => Ok((0..model.containers.len()).collect()),
    }
}

/// How deep containers are.
struct Extent {
    /// For each container the levels of superstates in it.
    levels: Vec<u32>,
}

impl Extent {
    /// Works from the containers that use no other upwards; a model has no circles.
    fn of(model: &Model) -> Self {
        let mut users: Vec<Vec<usize>> = vec![Vec::new(); model.containers.len()];
        let mut waiting_for = vec![0_usize; model.containers.len()];
        for (index, _) in model.containers.iter().enumerate() {
            for used in uses(model, index) {
                users[used].push(index);
                waiting_for[index] += 1;
            }
        }
        let mut levels = vec![0; model.containers.len()];
        let mut ready: Vec<usize> = (0..levels.len())
            .filter(|index| waiting_for[*index] == 0)
            .collect();
        while let Some(index) = ready.pop() {
            for user in &users[index] {
                levels[*user] = levels[*user].max(levels[index] + 1);
                waiting_for[*user] -= 1;
                if waiting_for[*user] == 0 {
                    ready.push(*user);
                }
            }
        }
        Extent { levels }
    }
}

/// The containers that a container's superstates use, as often as they use them.
fn uses(model: &Model, container: usize) -> impl Iterator<Item = usize> {
    let regions = model.containers[container].regions.iter();
    regions
        .flat_map(|region| &region.states)
        .filter_map(|state| match state.kind {
            StateKind::Super { container } => Some(container),
            _ => None,
        })
}

/// States and transitions that are shown of a container.
fn count_shown(model: &Model, container: usize, shown: &Shown) -> (u64, u64) {
    if shown.is_plain() {
        return count(model, &[container], shown.levels());
    }
    let regions = &model.containers[container].regions;
    let states = regions
        .iter()
        .map(|region| region.states.len() as u64)
        .sum();
    let transitions = (regions.iter())
        .map(|region| region.transitions.len() as u64)
        .sum();
    let mut counted: (u64, u64) = (states, transitions);
    for region in regions {
        for state in &region.states {
            let StateKind::Super { container } = state.kind else {
                continue;
            };
            if let Some(inner) = shown.inside(&region.name, &state.name) {
                let inside = count_shown(model, container, &inner);
                counted.0 = counted.0.saturating_add(inside.0);
                counted.1 = counted.1.saturating_add(inside.1);
            }
        }
    }
    counted
}

/// States and transitions that are shown, as far as they can be counted.
fn count(model: &Model, roots: &[usize], levels: u32) -> (u64, u64) {
    // How often each container is shown, level by level.
    let mut times = vec![0_u64; model.containers.len()];
    for root in roots {
        times[*root] += 1;
    }
    let (mut states, mut transitions) = (0_u64, 0_u64);
    for level in 0..=levels {
        let mut inside = vec![0_u64; times.len()];
        for (index, count) in times.iter().enumerate().filter(|(_, count)| **count > 0) {
            for region in &model.containers[index].regions {
                let add =
                    |sum: u64, each: usize| sum.saturating_add(count.saturating_mul(each as u64));
                states = add(states, region.states.len());
                transitions = add(transitions, region.transitions.len());
            }
            if level < levels {
                for used in uses(model, index) {
                    inside[used] = inside[used].saturating_add(*count);
                }
            }
        }
        times = inside;
    }
    (states, transitions)
}
