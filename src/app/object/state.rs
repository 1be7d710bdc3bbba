//! What is chosen and known while the object is selected.

use std::sync::Arc;

use glam::Vec2;

use crate::train::masks::{FoundObject, Selection, Stroke};

/// Brush at first, as a share of a photo's shorter side, and its limits.
const BRUSH: f32 = 0.012;
const BRUSHES: [f32; 2] = [0.002, 0.1];

/// What a person does to select the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ObjectCommand {
    /// Begin to select, or leave without the object.
    Select(bool),
    /// The object is at this place of the photo at hand, pixels.
    PointAt(Vec2),
    /// The object is what the photos look at.
    LookedAt,
    /// Whether strokes add to the object.
    SetAdds(bool),
    /// The brush's radius as a share of the photo's shorter side.
    SetBrush(f32),
    /// The brush is at this place of the photo at hand, pixels.
    Draw {
        /// Where.
        at: Vec2,
        /// Whether it adds.
        adds: bool,
    },
    /// The brush is lifted.
    Lift,
    /// The last stroke is taken back.
    Undo,
    /// What was taken back is drawn again.
    Redo,
    /// Look at the place once more, with what training has learned since.
    Again,
    /// Another one is meant.
    Another,
    /// Train with it.
    Train,
}

/// How the search goes.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Search {
    /// Nothing is searched.
    #[default]
    Idle,
    /// What is done, and which share of it.
    Busy(&'static str, f32),
    /// Why there is nothing.
    Failed(String),
}

/// The selection as it stands.
#[derive(Clone, Debug)]
pub struct ObjectState {
    /// Whether the object is being selected.
    pub is_open: bool,
    /// Which one, once somebody said.
    pub selection: Option<Selection>,
    /// What was drawn, oldest first.
    pub strokes: Vec<Stroke>,
    /// What was taken back, newest first at the end.
    pub undone: Vec<Stroke>,
    /// What is being drawn.
    pub drawing: Option<Stroke>,
    /// Whether strokes add to the object.
    pub adds: bool,
    /// The brush's radius as a share of the photo's shorter side.
    pub brush: f32,
    /// How often somebody asked to look at the place once more.
    pub n_looks: usize,
    /// The training step at which it was looked at last.
    pub step: u64,
    /// How the search goes.
    pub search: Search,
    /// The strokes that were heard for it.
    pub heard: Vec<Stroke>,
    /// What was found last.
    pub found: Option<Arc<FoundObject>>,
}

impl Default for ObjectState {
    fn default() -> Self {
        Self {
            is_open: false,
            selection: None,
            strokes: Vec::new(),
            undone: Vec::new(),
            drawing: None,
            adds: true,
            brush: BRUSH,
            n_looks: 0,
            step: 0,
            search: Search::Idle,
            heard: Vec::new(),
            found: None,
        }
    }
}

impl ObjectState {
    /// What was drawn and is not yet heard.
    pub fn unheard(&self) -> impl Iterator<Item = &Stroke> {
        let pairs = self.strokes.iter().zip(&self.heard);
        let n_heard = pairs.take_while(|(a, b)| a == b).count();
        self.strokes[n_heard..].iter().chain(&self.drawing)
    }

    /// The brush of that size, within its limits.
    pub fn set_brush(&mut self, share: f32) {
        self.brush = share.clamp(BRUSHES[0], BRUSHES[1]);
    }
}
