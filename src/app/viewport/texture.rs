//! Pictures on their way to the graphics card.

use egui::{ColorImage, Context, TextureHandle, TextureOptions};

/// Opaque sRGB pixels, row by row, `size` wide and high, as a new texture.
pub(in crate::app) fn upload(
    ctx: &Context,
    name: &str,
    (size, pixels): ([usize; 2], &[[u8; 4]]),
    options: TextureOptions,
) -> TextureHandle {
    ctx.load_texture(name, image(size, pixels), options)
}

/// The same in the place of the texture that is there, if one is; smooth where it is enlarged.
pub(in crate::app) fn renew(
    ctx: &Context,
    texture: &mut Option<TextureHandle>,
    name: &str,
    (size, pixels): ([usize; 2], &[[u8; 4]]),
) {
    let options = TextureOptions::LINEAR;
    match texture {
        Some(texture) => texture.set(image(size, pixels), options),
        None => *texture = Some(upload(ctx, name, (size, pixels), options)),
    }
}

fn image(size: [usize; 2], pixels: &[[u8; 4]]) -> ColorImage {
    ColorImage::from_rgba_premultiplied(size, pixels.as_flattened())
}
