//! A drive on one sheet: the path over the map, numbers over time, states over time.

use super::curves::Curves;
use super::path::PathPicture;
use super::scene::Scene;
use super::timeline::Timeline;

/// What is drawn of a drive, one below the other. What is not there is left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DrivePicture {
    /// What the picture is.
    pub title: String,
    /// The path.
    pub path: Option<PathPicture>,
    /// Speeds and ranges.
    pub curves: Curves,
    /// The states.
    pub states: Option<Timeline>,
}

impl DrivePicture {
    /// The picture, ready to become SVG or PNG.
    pub fn scene(&self) -> Scene {
        /// Where plots begin without names of states before them.
        const LEFT: f32 = 96.0;
        let mut scene = Scene::new(0.0, 0.0, &self.title);
        if let Some(path) = &self.path {
            scene.below(path.scene());
        }
        // One time axis below the other.
        let left = self.states.as_ref().map_or(LEFT, Timeline::left);
        if !self.curves.panels.is_empty() {
            scene.below(self.curves.scene(left));
        }
        if let Some(states) = &self.states {
            scene.below(states.scene());
        }
        scene
    }
}
