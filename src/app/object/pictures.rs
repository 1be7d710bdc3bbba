//! The window's side of the search: asks for what the state wants, takes in what was found, and keeps its pictures on the
//! graphics card.

use std::collections::HashMap;
use std::sync::Arc;

use egui::{Context, TextureHandle, TextureId, TextureOptions};

use super::finder::{Finder, News, Request};
use super::state::Search;
use crate::app::state::app_state::AppState;
use crate::app::state::training_state::Level;
use crate::app::viewport::texture;
use crate::app::work::opener::ScreenPhoto;
use crate::geometry::Camera;
use crate::train::masks::LearnedPlace;

/// Said where the system gives no thread.
const NO_THREAD: &str = "The object cannot be searched: no threads";

/// Pictures of the selection.
#[derive(Clone, Debug, Default)]
pub struct ObjectPictures {
    /// The photo at hand with the object's outline.
    pub outlined: Option<TextureId>,
    /// The object's shape over the photo at hand, and its width and height in pixels.
    pub shape: Option<(TextureId, [usize; 2])>,
    /// Small pictures of the photos with the outline, by the photo's index; width and height in pixels.
    pub thumbnails: HashMap<usize, (TextureId, [usize; 2])>,
}

/// A picture of a photo, by its index.
type Picture = Option<(usize, TextureHandle)>;

/// The thread and its pictures.
#[derive(Default)]
pub(in crate::app) struct ObjectSide {
    finder: Option<Finder>,
    /// Looks that were asked for.
    n_looks: usize,
    asked: Option<Request>,
    outlined: Picture,
    shape: Picture,
    thumbnails: HashMap<usize, TextureHandle>,
}

impl ObjectSide {
    /// Asks and takes in. `cameras` are those of the training photos as training has corrected them, where it has.
    pub(in crate::app) fn update(
        &mut self,
        ctx: &Context,
        state: &mut AppState,
        cameras: impl FnOnce() -> Option<Arc<Vec<Camera>>>,
    ) {
        if !state.object.is_open {
            *self = Self::default();
            return;
        }
        if self.n_looks != state.object.n_looks {
            self.n_looks = state.object.n_looks;
            (self.finder, self.asked) = (None, None);
        }
        if self.finder.is_none() && !matches!(state.object.search, Search::Failed(_)) {
            self.begin(ctx, state, cameras());
        }
        self.take(ctx, state);
        self.ask(state);
    }

    /// What is there.
    pub(in crate::app) fn pictures(&self, view: Option<usize>) -> ObjectPictures {
        let of_view = |picture: &Picture| {
            let found = picture.as_ref().filter(|(of, _)| Some(*of) == view);
            found.map(|(_, texture)| (texture.id(), texture.size()))
        };
        let thumbnails = self.thumbnails.iter();
        ObjectPictures {
            outlined: of_view(&self.outlined).map(|(id, _)| id),
            shape: of_view(&self.shape),
            thumbnails: thumbnails
                .map(|(view, texture)| (*view, (texture.id(), texture.size())))
                .collect(),
        }
    }

    /// Starts the thread with what training knows by now.
    fn begin(&mut self, ctx: &Context, state: &mut AppState, cameras: Option<Arc<Vec<Camera>>>) {
        let (Some(dataset), Some(snapshot)) = (&state.dataset, &state.snapshot) else {
            return;
        };
        let place = LearnedPlace {
            environment: Arc::clone(&snapshot.environment),
            cameras: cameras.map(|cameras| cameras.to_vec()),
        };
        let wake = ctx.clone();
        let finder = Finder::new(Arc::clone(dataset), place, move || wake.request_repaint());
        state.object.step = snapshot.step;
        match finder {
            Ok(finder) => self.finder = Some(finder),
            Err(error) => {
                let reason = format!("{NO_THREAD}\n{error}");
                state.object.search = Search::Failed(reason.clone());
                state.messages.say(Level::Error, reason);
            }
        }
    }

    fn take(&mut self, ctx: &Context, state: &mut AppState) {
        while let Some(news) = self.finder.as_ref().and_then(Finder::next) {
            let object = &mut state.object;
            match news {
                News::Busy(what, fraction) => object.search = Search::Busy(what, fraction),
                News::Rest => {
                    tracing::debug!("object search rests");
                    object.search = Search::Idle;
                }
                News::Failed(reason) => object.search = Search::Failed(reason),
                News::Found(found, strokes) => {
                    tracing::debug!(
                        photos = found.masks.len(),
                        doubtful = found.doubtful().len(),
                        "object found"
                    );
                    object.found = Some(found);
                    object.heard = strokes;
                }
                News::Outlined(view, photo) => renew(ctx, &mut self.outlined, view, &photo),
                News::Shape(view, photo) => renew(ctx, &mut self.shape, view, &photo),
                News::Thumbnail(view, photo) => {
                    let pixels = (photo.size, photo.pixels.as_slice());
                    let options = TextureOptions::LINEAR;
                    let texture = texture::upload(ctx, "photo with outline", pixels, options);
                    self.thumbnails.insert(view, texture);
                }
            }
        }
    }

    fn ask(&mut self, state: &AppState) {
        let (Some(selection), Some(view)) = (state.object.selection, state.object_view()) else {
            self.forget();
            return;
        };
        let asked = self.asked.as_ref();
        if asked.is_some_and(|asked| asked.selection != selection) {
            self.forget();
        }
        let request = Request {
            selection,
            strokes: state.object.strokes.clone(),
            view,
        };
        let is_new = self.asked.as_ref() != Some(&request);
        // Another photo is no reason to search anew what is being searched.
        let is_busy = matches!(state.object.search, Search::Busy(..));
        let says_more = self.asked.as_ref().is_none_or(|asked| {
            (&asked.selection, &asked.strokes) != (&request.selection, &request.strokes)
        });
        if let Some(finder) = &self.finder
            && is_new
            && (says_more || !is_busy)
        {
            finder.ask(request.clone());
            self.asked = Some(request);
        }
    }

    /// Drops the pictures of another object; the small ones are drawn over.
    fn forget(&mut self) {
        (self.asked, self.outlined, self.shape) = (None, None, None);
    }
}

fn renew(ctx: &Context, picture: &mut Picture, view: usize, photo: &ScreenPhoto) {
    let mut texture = picture.take().map(|(_, texture)| texture);
    let pixels = (photo.size, photo.pixels.as_slice());
    texture::renew(ctx, &mut texture, "photo with outline", pixels);
    *picture = texture.map(|texture| (view, texture));
}
