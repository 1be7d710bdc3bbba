//! The window's side of eframe: textures, keys, dropped files, and one frame after the other.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::{CreationContext, Frame};
use egui::{Context, TextureHandle, TextureOptions, Ui};

use super::changes::apply::apply;
use super::changes::{history, leaving};
use super::inspect::Inspector;
use super::inspect::driver::Wanted;
use super::keys::shortcuts;
use super::lighting::gallery_pictures::GalleryPictures;
use super::lighting::preview_side::PreviewSide;
use super::object::pictures::ObjectSide;
use super::session::autosave::Autosave;
use super::session::leaving::LeavingCommand;
use super::session::preferences::{self, Preferences, PreferencesCommand};
use super::session::recent;
use super::state::app_state::{Adapter, AppState};
use super::state::command::{Command, Effect};
use super::state::training_state::Level;
use super::viewport::overlay::Pictures;
use super::viewport::texture;
use super::work::error_maps::ErrorMaps;
use super::work::keeper::Keep;
use super::work::opener::ScreenPhoto;
use super::work::preview_driver::Situation;
use super::work::slice_view::SliceView;
use super::work::tasks::{News, Work};
use super::{assets, shell, theme};
use crate::app::AppOptions;
use crate::geometry::Camera;
use crate::render::GpuChoice;
use crate::render::library::Library;
use crate::train::Snapshot;

/// Pictures on the graphics card.
#[derive(Default)]
struct Textures {
    /// The photo and the view it is of.
    photo: Option<(usize, TextureHandle)>,
    /// What is shown before the preview, its size in pixels and what is said of it.
    first: Option<(TextureHandle, [usize; 2], &'static str)>,
    /// The view whose photo was asked for.
    asked_photo: Option<usize>,
}

/// The application as eframe drives it.
pub(super) struct Window {
    state: AppState,
    work: Work,
    inspector: Inspector,
    preview: PreviewSide,
    /// The other look, once it was compared with.
    preview_b: Option<PreviewSide>,
    gallery: GalleryPictures,
    textures: Textures,
    errors: ErrorMaps,
    slice: SliceView,
    object: ObjectSide,
    viewport: (u32, u32),
    started: Instant,
    n_cores: usize,
    gpu: GpuChoice,
    title: String,
    autosave: Autosave,
    keeping: Keeping,
}

/// Which preferences are in effect, and which are in their file.
struct Keeping {
    file: Option<PathBuf>,
    applied: Option<Preferences>,
    kept: Preferences,
    is_full_screen: bool,
    /// The window's size in the last frame.
    seen_size: Option<egui::Vec2>,
}

impl Window {
    /// Sets the window up and begins to open what was asked for; reads nothing itself.
    pub(super) fn new(
        creation: &CreationContext<'_>,
        options: AppOptions,
    ) -> std::io::Result<Self> {
        let ctx = &creation.egui_ctx;
        theme::set_up(ctx);
        let mut window = Self {
            state: AppState {
                adapter: adapter(creation),
                ..AppState::default()
            },
            work: Work::new(ctx)?,
            inspector: Inspector::new(ctx)?,
            preview: PreviewSide::new(ctx, "preview", 0, options.gpu)?,
            preview_b: None,
            gallery: GalleryPictures::new(ctx)?,
            textures: Textures::default(),
            errors: ErrorMaps::new()?,
            slice: SliceView::default(),
            object: ObjectSide::default(),
            viewport: (0, 0),
            started: Instant::now(),
            n_cores: std::thread::available_parallelism().map_or(1, usize::from),
            gpu: options.gpu,
            title: String::new(),
            autosave: Autosave::new(),
            keeping: Keeping {
                file: preferences::file(),
                applied: None,
                kept: Preferences::default(),
                is_full_screen: false,
                seen_size: None,
            },
        };
        window.recall(ctx);
        window.list_library();
        window.state.recent = recent::load();
        window.work.read_as(&options.open, &options.choices);
        let mut effects: Vec<Effect> = options.open.into_iter().map(Effect::Open).collect();
        if effects.is_empty() {
            effects.push(Effect::OpenDemo);
        }
        window.carry_out(effects);
        Ok(window)
    }

    /// Takes up the preferences, and what an earlier window has left behind.
    fn recall(&mut self, ctx: &Context) {
        if let Some(file) = &self.keeping.file {
            let (preferences, problem) = preferences::load(file);
            self.keeping.kept.clone_from(&preferences);
            self.state.preferences = preferences;
            if let Some(problem) = problem {
                self.state.messages.say(Level::Warning, problem);
            }
        }
        self.prefer(ctx);
        if let Some(file) = self.autosave.left_behind() {
            self.work.opener().left_behind(file);
        }
    }

    /// Lists the library's environments; a listing alone, none of them is read.
    fn list_library(&mut self) {
        match assets::environments(&Library::of_system()) {
            Ok(environments) => self.state.environments = environments,
            Err(error) => {
                let what = format!("The library of environments is not shown\n{error}");
                self.state.messages.say(Level::Warning, what);
            }
        }
    }

    /// Notes the size of the window once it stays; full screen and the like are not kept.
    fn note_size(&mut self, ctx: &Context) {
        let (size, is_usual) = ctx.input(|input| {
            let viewport = input.viewport();
            let is_usual = viewport.maximized != Some(true) && viewport.fullscreen != Some(true);
            (viewport.inner_rect.map(|rect| rect.size()), is_usual)
        });
        // In points of the system, whatever the size of the text.
        let size = size.map(|size| size * ctx.zoom_factor());
        let is_still = self.keeping.seen_size == size;
        self.keeping.seen_size = size;
        let Some(size) = size.filter(|_| is_usual && is_still) else {
            return;
        };
        let known = self.state.preferences.window.unwrap_or(super::SIZE);
        if (size.x - known[0]).abs() > 2.0 || (size.y - known[1]).abs() > 2.0 {
            let resize = PreferencesCommand::ResizeWindow([size.x, size.y]);
            let resize = Command::Preferences(resize);
            apply(&mut self.state, resize, &mut Vec::new());
        }
    }

    /// Puts changed preferences into effect and into their file.
    fn prefer(&mut self, ctx: &Context) {
        let preferences = &self.state.preferences;
        if self.keeping.applied.as_ref() != Some(preferences) {
            self.keeping.applied = Some(preferences.clone());
            theme::prefer(ctx, preferences);
        }
        if self.keeping.is_full_screen != self.state.is_full_screen {
            self.keeping.is_full_screen = self.state.is_full_screen;
            let fill = egui::ViewportCommand::Fullscreen(self.state.is_full_screen);
            ctx.send_viewport_cmd(fill);
        }
        if self.keeping.kept != *preferences
            && let Some(file) = &self.keeping.file
        {
            self.keeping.kept.clone_from(preferences);
            let text = preferences.to_text();
            self.work.keeper().keep(file, Keep::Write(text));
        }
    }

    /// Keeps what would otherwise be lost, and asks before it is.
    fn guard(&mut self, ctx: &Context) {
        history::watch(&mut self.state);
        let mut effects = Vec::new();
        leaving::after_news(&mut self.state, &mut effects);
        let is_closing = ctx.input(|input| input.viewport().close_requested());
        let must_ask = leaving::is_training_unsaved(&self.state) && !self.state.is_leaving_for_sure;
        if is_closing && must_ask {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            let close = Command::Leaving(LeavingCommand::Close);
            apply(&mut self.state, close, &mut effects);
        }
        self.carry_out(effects);
        if let Some(secs) = self.autosave.look(&self.state, self.work.keeper()) {
            ctx.request_repaint_after(Duration::from_secs_f64(secs));
        }
    }

    fn carry_out(&mut self, effects: Vec<Effect>) {
        for effect in effects {
            let news = self.work.carry_out(&mut self.state, effect);
            if matches!(news, Some(News::Reset)) {
                self.forget_pictures();
            }
        }
    }

    /// What came from the threads since the last frame.
    fn poll(&mut self, ctx: &Context) {
        self.state.messages.now_secs = self.started.elapsed().as_secs_f64();
        for news in self.work.poll(&mut self.state) {
            match news {
                News::FirstPicture(picture, words) => {
                    let texture = upload(ctx, "first picture", &picture);
                    self.textures.first = Some((texture, picture.size, words));
                }
                News::ViewPhoto(view, photo) => {
                    self.textures.photo = Some((view, upload(ctx, "photo", &photo)));
                }
                News::Reset => self.forget_pictures(),
            }
        }
        self.inspector.poll(ctx, &mut self.state.inspect);
        if let Some(shown) = self.preview.take_frame(ctx) {
            self.textures.first = None;
            self.state.shown = Some(shown);
            self.state.set_drawn_by(self.preview.drawn_by());
        }
        if let Some(b) = &mut self.preview_b {
            b.take_frame(ctx);
        }
    }

    /// Drops every picture of what was open before.
    fn forget_pictures(&mut self) {
        self.preview.clear();
        if let Some(b) = &mut self.preview_b {
            b.clear();
        }
        self.gallery.forget_own();
        self.errors.clear();
        self.slice = SliceView::default();
        self.textures = Textures::default();
        self.state.shown = None;
    }

    /// Asks the preview for what is missing, and the opener for the photo to compare with.
    fn ask(&mut self, ctx: &Context) {
        self.ask_photo();
        let Some(snapshot) = self.state.snapshot.clone() else {
            return;
        };
        // While the object is selected, the photo is in the preview's place.
        if self.viewport.0.min(self.viewport.1) < 16 || self.state.object.is_open {
            return;
        }
        let training = &self.state.training;
        let is_split = self.state.lighting.split.is_some();
        let situation = Situation {
            now_secs: self.state.messages.now_secs,
            is_training: self.state.is_learning(),
            trained_secs: training.progress.elapsed_secs,
            drag_share: self.state.pace.drag_share(),
            // Two pictures share what refreshes may take.
            n_cores: (self.n_cores / if is_split { 2 } else { 1 }).max(1),
        };
        let state = &self.state;
        let camera = state.window_camera(self.viewport);
        let a = |snapshot: &_| state.picture_of(state.scene_of(snapshot), camera);
        self.preview.ask(ctx, &snapshot, a, &situation);
        let wanted = state.inspect.pick.map(|pick| Wanted {
            pick,
            view: pick.seen_by(&camera),
            scene: state.scene_of(&snapshot),
            up: state.view.up,
            is_sharp: state.inspect.is_sharp,
        });
        self.inspector.ask(ctx, wanted, &situation);
        if is_split {
            self.ask_b(ctx, &snapshot, camera, &situation);
        }
    }

    /// Asks for the picture of the look that is kept as B.
    fn ask_b(
        &mut self,
        ctx: &Context,
        snapshot: &Arc<Snapshot>,
        camera: Camera,
        situation: &Situation,
    ) {
        if self.preview_b.is_none() {
            let n_threads = self.n_cores.div_ceil(2);
            self.preview_b = PreviewSide::new(ctx, "preview of B", n_threads, self.gpu)
                .inspect_err(|error| tracing::error!("no threads to compare with: {error}"))
                .ok();
        }
        if let Some(side) = &mut self.preview_b {
            let state = &self.state;
            let b = |snapshot: &_| {
                let kept = state.kept_scene_of(snapshot);
                let scene = kept.unwrap_or_else(|| state.scene_of(snapshot));
                state.picture_of(scene, camera)
            };
            side.ask(ctx, snapshot, b, situation);
        }
    }

    fn ask_photo(&mut self) {
        let Some(view) = self.state.view.at_view else {
            return;
        };
        if self.textures.asked_photo != Some(view)
            && let Some(dataset) = &self.state.dataset
        {
            self.textures.asked_photo = Some(view);
            self.work.opener().view_photo(dataset, view);
        }
    }

    fn pictures(&self) -> Pictures {
        let (textures, state) = (&self.textures, &self.state);
        let photo = textures.photo.as_ref();
        let photo = photo.filter(|(view, _)| Some(*view) == state.view.at_view);
        let b = self.preview_b.as_ref();
        let b = b.filter(|_| state.lighting.split.is_some());
        let first = textures.first.as_ref();
        Pictures {
            preview: self.preview.texture(),
            preview_b: b.and_then(PreviewSide::texture),
            thumbnails: self.gallery.of_files(),
            own_thumbnail: self.gallery.own(),
            photo: photo.map(|(_, texture)| texture.id()),
            error: self.errors.texture(state),
            slice: self.slice.texture(),
            first: first.map(|(texture, size, words)| (texture.id(), *size, *words)),
            panorama: self.inspector.texture(),
            object: self.object.pictures(state.object_view()),
        }
    }

    fn set_title(&mut self, ctx: &Context) {
        let name = self.state.source.name();
        let title = format!("{name} – neif");
        if title != self.title {
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }
}

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut Ui, frame: &mut Frame) {
        let ctx = ui.ctx().clone();
        let took = frame.info().cpu_usage.unwrap_or(0.0);
        tracing::trace!(frame = self.state.messages.now_secs, took, "drawing");
        self.poll(&ctx);
        let mut commands = Vec::new();
        shortcuts::pressed(&ctx, &self.state, &mut commands);
        self.viewport = shell::draw(ui, &self.state, &self.pictures(), &mut commands);
        self.state.export.window_px = self.viewport;
        commands.extend(dropped(&ctx));
        let mut effects = Vec::new();
        let has_commands = !commands.is_empty();
        for command in commands {
            tracing::debug!(?command, "command");
            apply(&mut self.state, command, &mut effects);
        }
        self.carry_out(effects);
        self.note_size(&ctx);
        self.prefer(&ctx);
        self.guard(&ctx);
        self.ask(&ctx);
        self.gallery.update(&ctx, &self.state);
        self.errors.update(&ctx, &mut self.state);
        self.slice.update(&ctx, &mut self.state);
        self.object
            .update(&ctx, &mut self.state, || self.work.cameras());
        self.set_title(&ctx);
        if has_commands {
            ctx.request_repaint();
        }
        if let Some(secs) = self.state.messages.next_change_secs() {
            ctx.request_repaint_after(Duration::from_secs_f64(secs.max(0.05)));
        }
    }

    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        theme::background(visuals.dark_mode).to_normalized_gamma_f32()
    }

    fn on_exit(&mut self) {
        self.autosave.end(&self.state, self.work.keeper());
        self.work.close();
    }
}

/// Dropped files, as commands.
fn dropped(ctx: &Context) -> Vec<Command> {
    ctx.input(|input| {
        let files = input.raw.dropped_files.iter();
        files
            .map(|file| Command::Open(file.path().to_owned()))
            .collect()
    })
}

fn upload(ctx: &Context, name: &str, photo: &ScreenPhoto) -> TextureHandle {
    let pixels = (photo.size, photo.pixels.as_slice());
    texture::upload(ctx, name, pixels, TextureOptions::LINEAR)
}

fn adapter(creation: &CreationContext<'_>) -> Adapter {
    let render = creation.wgpu_render_state.as_ref();
    render.map_or_else(Adapter::default, |render| {
        let info = render.adapter.get_info();
        Adapter {
            details: format!("{}, {} {}", info.backend, info.driver, info.driver_info),
            name: info.name,
            is_software: info.device_type == wgpu::DeviceType::Cpu,
        }
    })
}
