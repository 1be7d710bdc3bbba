//! What the window has said: shown for a while over the viewport, and kept in a list.

use std::collections::VecDeque;

use super::training_state::Level;

/// Messages kept.
const MAX_MESSAGES: usize = 200;
/// How long good news is shown, in seconds; errors stay until they are dismissed.
const SHOWN_SECS: f64 = 6.0;
/// How long warnings are shown, in seconds.
const WARNING_SECS: f64 = 12.0;

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// How much it matters.
    pub level: Level,
    /// The words.
    pub text: String,
    /// What caused it, the nearest first; none where nothing more is known.
    pub causes: Vec<String>,
    /// Seconds since the window opened.
    pub at_secs: f64,
    /// Whether it was dismissed.
    pub is_dismissed: bool,
}

/// All messages, oldest first, and the time by the window's clock.
#[derive(Clone, Debug, Default)]
pub struct Messages {
    list: VecDeque<Message>,
    /// Seconds since the window opened; set at every frame.
    pub now_secs: f64,
}

impl Messages {
    /// Adds a message; the same one twice in a row is kept once. Lines after the first are its causes.
    pub fn say(&mut self, level: Level, text: impl Into<String>) {
        let lines = text.into();
        let mut lines = lines.lines().map(str::to_owned);
        let text = lines.next().unwrap_or_default();
        let causes: Vec<_> = lines.collect();
        self.list
            .pop_back_if(|last| last.text == text && last.level == level);
        match level {
            Level::Error => tracing::error!("{text}"),
            Level::Warning => tracing::warn!("{text}"),
            Level::Info => tracing::info!("{text}"),
        }
        self.list.push_back(Message {
            level,
            text,
            causes,
            at_secs: self.now_secs,
            is_dismissed: false,
        });
        if self.list.len() > MAX_MESSAGES {
            self.list.pop_front();
        }
    }

    /// All of them, oldest first.
    pub fn all(&self) -> impl DoubleEndedIterator<Item = &Message> + ExactSizeIterator {
        self.list.iter()
    }

    /// Those to show over the viewport, by index, newest first.
    pub fn shown(&self) -> impl Iterator<Item = (usize, &Message)> {
        self.list
            .iter()
            .enumerate()
            .rev()
            .filter(|(_, message)| self.secs_left(message).is_some())
            .take(4)
    }

    /// Seconds until the next of the shown messages goes.
    pub fn next_change_secs(&self) -> Option<f64> {
        let left = self
            .list
            .iter()
            .filter_map(|message| self.secs_left(message));
        left.filter(|secs| secs.is_finite()).min_by(f64::total_cmp)
    }

    fn secs_left(&self, message: &Message) -> Option<f64> {
        let lasts = match message.level {
            Level::Info => SHOWN_SECS,
            Level::Warning => WARNING_SECS,
            Level::Error => f64::INFINITY,
        };
        let left = message.at_secs + lasts - self.now_secs;
        (!message.is_dismissed && left > 0.0).then_some(left)
    }

    /// Takes a message off the viewport.
    pub fn dismiss(&mut self, index: usize) {
        if let Some(message) = self.list.get_mut(index) {
            message.is_dismissed = true;
        }
    }

    /// The whole list as text, a line a message.
    pub fn to_text(&self) -> String {
        let lines: Vec<_> = self.list.iter().map(Message::to_text).collect();
        lines.join("\n")
    }
}

impl Message {
    /// As text: a line, and one more for each cause.
    pub fn to_text(&self) -> String {
        let mut text = format!("{:8.1}s {:?}: {}", self.at_secs, self.level, self.text);
        for cause in &self.causes {
            text.push_str("\n    because ");
            text.push_str(cause);
        }
        text
    }
}

/// An error and what caused it, a line each; causes that the lines before already state are left out.
pub fn with_causes(error: &(dyn std::error::Error + 'static)) -> String {
    let mut text = error.to_string();
    let causes = std::iter::successors(error.source(), |error| error.source());
    for cause in causes.map(ToString::to_string) {
        if !text.contains(&cause) {
            text.push('\n');
            text.push_str(&cause);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn good_news_goes_by_itself_and_errors_stay() {
        let mut messages = Messages::default();
        messages.say(Level::Info, "saved");
        messages.say(Level::Error, "disk full");
        assert_eq!(messages.shown().count(), 2);
        assert_eq!(messages.next_change_secs(), Some(SHOWN_SECS));
        messages.now_secs = 1000.0;
        assert_eq!(messages.shown().map(|(i, _)| i).collect::<Vec<_>>(), [1]);
        messages.dismiss(1);
        assert_eq!(messages.shown().count(), 0);
        assert_eq!(messages.all().len(), 2);
    }

    #[test]
    fn causes_are_listed_once_each() {
        #[derive(Debug, thiserror::Error)]
        #[error("cannot read the run")]
        struct Outer(#[source] std::io::Error);
        let error = Outer(std::io::Error::other("disk gone"));
        let mut messages = Messages::default();
        messages.say(Level::Error, with_causes(&error));
        let message = messages.all().next().unwrap();
        assert_eq!(message.text, "cannot read the run");
        assert_eq!(message.causes, ["disk gone"]);
        assert!(message.to_text().ends_with("because disk gone"));
    }

    #[test]
    fn a_repeated_message_is_kept_once() {
        let mut messages = Messages::default();
        for _ in 0..3 {
            messages.say(Level::Warning, "same");
        }
        assert_eq!(messages.all().len(), 1);
    }
}
