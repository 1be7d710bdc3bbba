//! How the window looks: pictures of it against stored ones, as blocks of pixels, so that fonts may differ a little.
//!
//! Needs a graphics adapter (lavapipe will do); skipped with a line where there is none, a failure with
//! `NEIF_TEST_WINDOW=1`. After a wanted change, `NEIF_UPDATE_PICTURES=1` stores the new ones.
#![expect(clippy::print_stdout, reason = "tests report what they skip")]

use std::path::{Path, PathBuf};

use egui::{Color32, ColorImage, TextureOptions};
use egui_kittest::Harness;
use egui_kittest::wgpu::WgpuTestRenderer;
use image::RgbaImage;
use neif::app::session::preferences::ThemeChoice;
use neif::app::state::export::{ExportCommand, Subject};
use neif::app::viewport::overlay::Pictures;
use neif::app::{AppState, Command, apply, shell, theme};

use super::{inspect, training_state};

/// Width and height of the window, points.
const SIZE: [f32; 2] = [1280.0, 800.0];
/// Side of a block, pixels.
const BLOCK: u32 = 16;
/// Largest difference of a channel's mean in a block that counts as equal, codes.
const TOLERANCE: f32 = 14.0;
/// Share of the blocks that may differ.
const MOST_DIFFERENT: f32 = 0.02;

#[test]
fn the_window_looks_as_it_did() {
    let Some(renderer) = renderer() else { return };
    let empty = AppState::default();
    let mut demo = training_state();
    demo.snapshot = Some(inspect::snapshot());
    let mut export = demo.clone();
    export.preferences.theme = ThemeChoice::Light;
    let show = Command::Export(ExportCommand::Show(Subject::Turntable));
    apply(&mut export, show, &mut Vec::new());
    let mut renderer = Some(renderer);
    let mut different = Vec::new();
    for (name, state) in [("empty", empty), ("training", demo), ("export", export)] {
        let renderer = renderer.take().or_else(self::renderer);
        let shown = picture(state, renderer.expect("there was one"));
        different.extend(compare(name, &shown));
    }
    assert!(different.is_empty(), "{}", different.join("\n"));
}

fn renderer() -> Option<WgpuTestRenderer> {
    let Ok(renderer) = std::panic::catch_unwind(WgpuTestRenderer::new) else {
        assert!(
            std::env::var_os("NEIF_TEST_WINDOW").is_none(),
            "there is no graphics adapter"
        );
        println!("skipped: there is no graphics adapter to draw the window with");
        return None;
    };
    Some(renderer)
}

/// The window with a picture of its own in the viewport.
fn picture(state: AppState, renderer: WgpuTestRenderer) -> RgbaImage {
    let mut texture = None;
    let draw = move |ui: &mut egui::Ui, state: &mut AppState| {
        let preview = texture.get_or_insert_with(|| {
            theme::set_up(ui.ctx());
            theme::prefer(ui.ctx(), &state.preferences);
            let colors =
                (0..64 * 64).map(|i| Color32::from_rgb(i as u8 % 64 * 4, 90, (i / 64) as u8 * 4));
            let image = ColorImage::new([64, 64], colors.collect());
            ui.ctx()
                .load_texture("preview", image, TextureOptions::LINEAR)
        });
        let pictures = Pictures {
            preview: state.snapshot.is_some().then(|| preview.id()),
            ..Pictures::default()
        };
        let ground = theme::background(ui.visuals().dark_mode);
        ui.painter()
            .rect_filled(ui.ctx().content_rect(), 0.0, ground);
        shell::draw(ui, state, &pictures, &mut Vec::new());
    };
    let mut harness = Harness::builder()
        .with_size(SIZE)
        .renderer(renderer)
        .build_ui_state(draw, state);
    harness.run_steps(4);
    harness.render().expect("a picture")
}

/// What is wrong with a picture, if anything.
fn compare(name: &str, shown: &RgbaImage) -> Option<String> {
    let stored =
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/ui/pictures/{name}.png"));
    if std::env::var_os("NEIF_UPDATE_PICTURES").is_some() {
        shown.save(&stored).expect("the picture is stored");
        return None;
    }
    let wanted = image::open(&stored).expect("a stored picture").to_rgba8();
    if shown.dimensions() != wanted.dimensions() {
        return Some(format!("{name}: {:?}", shown.dimensions()));
    }
    let (shown_blocks, wanted_blocks) = (blocks(shown), blocks(&wanted));
    let differs = |(a, b): &(&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > TOLERANCE);
    let n = shown_blocks
        .iter()
        .zip(&wanted_blocks)
        .filter(differs)
        .count();
    if n as f32 <= MOST_DIFFERENT * shown_blocks.len() as f32 {
        return None;
    }
    let new = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.png"));
    shown.save(&new).expect("the picture is kept");
    Some(format!(
        "{name}: {n} of {} blocks differ from {}; the picture is in {}",
        shown_blocks.len(),
        stored.display(),
        new.display()
    ))
}

/// Means of red, green and blue, block by block.
fn blocks(picture: &RgbaImage) -> Vec<[f32; 3]> {
    let (width, height) = picture.dimensions();
    let starts = (0..height / BLOCK).flat_map(|y| (0..width / BLOCK).map(move |x| (x, y)));
    let mean = |(x, y): (u32, u32)| {
        let mut sum = [0.0; 3];
        for (dx, dy) in (0..BLOCK * BLOCK).map(|i| (i % BLOCK, i / BLOCK)) {
            let pixel = picture.get_pixel(x * BLOCK + dx, y * BLOCK + dy);
            for c in 0..3 {
                sum[c] += f32::from(pixel[c]) / (BLOCK * BLOCK) as f32;
            }
        }
        sum
    };
    starts.map(mean).collect()
}
