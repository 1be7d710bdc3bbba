//! Looking for a command by its name: what is typed, and which answer is chosen.

/// What is typed, and which of the answers is chosen.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Palette {
    /// Words, or letters in order.
    pub typed: String,
    /// Index among [`crate::app::changes::palette::found`].
    pub chosen: usize,
}

/// What happens in the palette.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PaletteCommand {
    /// Show it, or hide it.
    Toggle,
    /// Text in its field.
    Type(String),
    /// Choose another answer, so many further down, around the end.
    Step(isize),
    /// Do the answer with this index.
    Run(usize),
}
