//! What draws the preview, a graphics card or the processor, and why: plain values for the window.

use std::str::FromStr;

/// Whether pictures are made by a graphics card.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GpuChoice {
    /// By a real one; a software adapter is slower than the processor's own path.
    #[default]
    Auto,
    /// By any adapter, software ones too.
    On,
    /// Never.
    Off,
}

impl GpuChoice {
    /// The environment variable that holds the choice.
    pub const VARIABLE: &str = "NEIF_GPU";
}

impl FromStr for GpuChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "" | "auto" => Ok(Self::Auto),
            "on" => Ok(Self::On),
            "off" => Ok(Self::Off),
            _ => Err(format!("`{text}` is none of auto, on, off")),
        }
    }
}

/// What draws the preview.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DrawnBy {
    /// No card was looked for yet.
    #[default]
    Undecided,
    /// The graphics card of this name.
    Card(String),
    /// The processor, though there is a card.
    ProcessorFor {
        /// The card's name.
        card: String,
        /// What of the picture the card's path does not carry.
        what: String,
    },
    /// The processor, as no card can be used.
    Processor {
        /// Why.
        why: String,
        /// Whether a card drew before and failed.
        has_failed: bool,
    },
}

impl DrawnBy {
    /// Whether a card may be asked for the next picture.
    pub fn may_use_card(&self) -> bool {
        !matches!(self, Self::Processor { .. })
    }

    /// After a card could not be opened, or failed while it drew: the processor draws from then on.
    pub fn after_failure(&self, why: String) -> Self {
        Self::Processor {
            why,
            has_failed: !matches!(self, Self::Undecided | Self::Processor { .. }),
        }
    }

    /// What to tell a person when this comes after `before`; nothing where all goes on as it was.
    pub fn news_after(&self, before: &Self) -> Option<String> {
        match self {
            Self::Processor {
                why,
                has_failed: true,
            } if before != self => Some(format!("The processor draws the preview now: {why}")),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_that_fails_is_reported_once_and_never_asked_again() {
        let card = DrawnBy::Card("Big Card".to_owned());
        let after = card.after_failure("`Big Card` was lost: unplugged".to_owned());
        assert!(!after.may_use_card());
        let news = after.news_after(&card).expect("something to tell");
        assert!(news.contains("unplugged"), "{news}");
        assert_eq!(after.news_after(&after), None);
    }

    #[test]
    fn where_no_card_ever_was_nobody_is_bothered() {
        let before = DrawnBy::default();
        let after = before.after_failure("no graphics card was found".to_owned());
        assert_eq!(after.news_after(&before), None);
        assert!(!after.may_use_card());
    }

    #[test]
    fn the_choice_is_one_of_three_words() {
        assert_eq!("on".parse(), Ok(GpuChoice::On));
        assert!("yes".parse::<GpuChoice>().unwrap_err().contains("auto"));
    }
}
