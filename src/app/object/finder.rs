//! The thread on which the object is found: it looks at the place once, then finds what is asked for, the newest request first.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crossbeam::channel::{Receiver, Sender, bounded};

use super::outlined::{outlined, thumbnail};
use crate::app::work::opener::ScreenPhoto;
use crate::app::work::threads;
use crate::data::Dataset;
use crate::render::preview::inbox::Inbox;
use crate::train::masks::{FoundObject, LearnedPlace, MaskError, ObjectFinder, Selection, Stroke};

/// Niceness: below the window, above the trainer. A person waits for it, and the preview rests meanwhile.
const NICE: i32 = 4;
/// Progress is reported in so many parts: each wakes the window.
const PARTS: f32 = 20.0;
/// News that may wait for the window.
const QUEUE: usize = 512;
/// What is done.
const LOOKING: &str = "Looking at the place from all photos";
const FINDING: &str = "Finding the object";

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Request {
    /// Which object.
    pub(super) selection: Selection,
    /// How it was corrected.
    pub(super) strokes: Vec<Stroke>,
    /// The photo at hand.
    pub(super) view: usize,
}

/// What came of it.
#[derive(Debug)]
pub(super) enum News {
    /// What is done, and which share of it.
    Busy(&'static str, f32),
    /// Nothing is done.
    Rest,
    /// Masks of all photos, and the strokes that were heard for them.
    Found(Arc<FoundObject>, Vec<Stroke>),
    /// Why there is nothing.
    Failed(String),
    /// A photo with the object's outline.
    Outlined(usize, ScreenPhoto),
    /// The same, small; before anything was found without the outline.
    Thumbnail(usize, ScreenPhoto),
    /// The object's shape over the photo at hand.
    Shape(usize, ScreenPhoto),
}

/// The window's end; dropping it ends the work.
#[derive(Debug)]
pub(super) struct Finder {
    inbox: Arc<Inbox<Request>>,
    leaves: Arc<AtomicBool>,
    news: Receiver<News>,
}

impl Drop for Finder {
    fn drop(&mut self) {
        self.leaves.store(true, Ordering::Relaxed);
        self.inbox.close();
    }
}

impl Finder {
    /// Starts the thread, which looks at the place at once; `wake` is called when there is news.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub(super) fn new(
        dataset: Arc<Dataset>,
        place: LearnedPlace,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> std::io::Result<Self> {
        let pool = threads::pool("neif-object", 0, NICE)?;
        let (sender, news) = bounded(QUEUE);
        let inbox = Arc::new(Inbox::default());
        let leaves = Arc::new(AtomicBool::new(false));
        let worker = Worker {
            dataset,
            inbox: Arc::clone(&inbox),
            leaves: Arc::clone(&leaves),
            outbox: Outbox {
                sender,
                wake: Box::new(wake),
                part: AtomicUsize::new(usize::MAX),
            },
            found: None,
            without_thumbnail: Vec::new(),
        };
        threads::spawn("neif-object", NICE, move || {
            pool.install(|| worker.work(&place));
        })?;
        Ok(Self {
            inbox,
            leaves,
            news,
        })
    }

    /// Asks instead of whatever was asked before.
    pub(super) fn ask(&self, request: Request) {
        self.inbox.put(request);
    }

    /// The next news, if there is any.
    pub(super) fn next(&self) -> Option<News> {
        self.news.try_recv().ok()
    }
}

struct Outbox {
    sender: Sender<News>,
    wake: Box<dyn Fn() + Send + Sync>,
    /// Of the progress, reported last.
    part: AtomicUsize,
}

impl Outbox {
    /// False once nobody listens any more.
    fn send(&self, news: News) -> bool {
        let is_heard = self.sender.send(news).is_ok();
        (self.wake)();
        is_heard
    }

    /// Progress that finds no room is not missed.
    fn report(&self, what: &'static str, fraction: f32) {
        let part = (PARTS * fraction) as usize;
        if self.part.swap(part, Ordering::Relaxed) == part {
            return;
        }
        if self.sender.try_send(News::Busy(what, fraction)).is_ok() {
            (self.wake)();
        }
    }
}

struct Worker {
    dataset: Arc<Dataset>,
    inbox: Arc<Inbox<Request>>,
    leaves: Arc<AtomicBool>,
    outbox: Outbox,
    /// What was found last, and for which request.
    found: Option<(Request, Arc<FoundObject>)>,
    /// Views whose small pictures are old, the next one last.
    without_thumbnail: Vec<usize>,
}

impl Worker {
    fn work(mut self, place: &LearnedPlace) {
        let report = |fraction| self.outbox.report(LOOKING, fraction);
        let mut finder = match ObjectFinder::new(&self.dataset, place, &self.leaves, &report) {
            Ok(finder) => finder,
            Err(MaskError::Cancelled) => return,
            Err(error) => {
                self.outbox.send(News::Failed(error.to_string()));
                return;
            }
        };
        for (index, view) in self.dataset.views().enumerate() {
            self.outbox
                .send(News::Thumbnail(index, thumbnail(view, None)));
        }
        self.outbox.send(News::Rest);
        while let Some((_, request)) = self.inbox.take() {
            if !self.answer(&mut finder, &request) {
                return;
            }
        }
    }

    /// False once nobody listens any more.
    fn answer(&mut self, finder: &mut ObjectFinder, request: &Request) -> bool {
        let is_known = self.found.as_ref().is_some_and(|(of, _)| {
            of.selection == request.selection && of.strokes == request.strokes
        });
        if !is_known {
            match self.find(finder, request) {
                Ok(()) => {}
                // Something newer waits.
                Err(MaskError::Cancelled) => return true,
                Err(error) => return self.outbox.send(News::Failed(error.to_string())),
            }
        }
        self.show(request.view)
    }

    fn find(&mut self, finder: &mut ObjectFinder, request: &Request) -> Result<(), MaskError> {
        let asked = (&request.selection, &request.strokes[..]);
        let same_object = self.found.as_ref();
        let same_object = same_object.filter(|(of, _)| of.selection == request.selection);
        let drawn = same_object.and_then(|(of, _)| changed_view(&of.strokes, &request.strokes));
        if let Some(index) = drawn
            && let Some(view) = self.dataset.views().nth(index)
            && let Some(mask) = finder.cut_one(&self.dataset, index, &request.strokes)
        {
            // Seen at once where it was drawn.
            let picture = outlined(view, &mask);
            self.outbox.send(News::Outlined(index, picture));
        }
        let report = |fraction| self.outbox.report(FINDING, fraction);
        let found = finder.find(&self.dataset, asked, self.inbox.superseded(), &report)?;
        let mut order: Vec<usize> = (0..found.masks.len()).collect();
        order.sort_by(|a, b| found.agreement[*b].total_cmp(&found.agreement[*a]));
        self.without_thumbnail = order;
        let found = Arc::new(found);
        let strokes = request.strokes.clone();
        self.outbox.send(News::Found(Arc::clone(&found), strokes));
        self.found = Some((request.clone(), found));
        Ok(())
    }

    /// Pictures of the view at hand, then the small ones that are old, until something newer is asked for.
    fn show(&mut self, index: usize) -> bool {
        let Some((_, found)) = &self.found else {
            return true;
        };
        if let Some((view, mask)) = self.dataset.views().zip(&found.masks).nth(index) {
            let outlined = outlined(view, mask);
            self.outbox.send(News::Outlined(index, outlined));
            let shape = found.picture(view);
            let [width, height] = shape.size;
            let shape = ScreenPhoto::thinned(width, height, |i| shape.pixels[i]);
            if !self.outbox.send(News::Shape(index, shape)) {
                return false;
            }
        }
        let views: Vec<_> = self.dataset.views().collect();
        while !self.inbox.is_superseded()
            && let Some(index) = self.without_thumbnail.pop()
        {
            let picture = thumbnail(views[index], Some(&found.masks[index]));
            if !self.outbox.send(News::Thumbnail(index, picture)) {
                return false;
            }
        }
        self.outbox.send(News::Rest)
    }
}

/// The photo of the first stroke in which two lists differ.
fn changed_view(before: &[Stroke], now: &[Stroke]) -> Option<usize> {
    let n_same = before.iter().zip(now).take_while(|(a, b)| a == b).count();
    let changed = now.get(n_same).or_else(|| before.get(n_same))?;
    Some(changed.view)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::train::masks::test_capture;

    #[test]
    fn what_was_drawn_or_taken_back_last_is_cut_first() {
        let stroke = |view| Stroke {
            view,
            places: Vec::new(),
            radius: 1.0,
            adds: true,
        };
        let (one, two) = ([stroke(3)], [stroke(3), stroke(5)]);
        assert_eq!(changed_view(&one, &two), Some(5), "drawn");
        assert_eq!(changed_view(&two, &one), Some(5), "taken back");
        assert_eq!(changed_view(&two, &two), None);
    }

    #[test]
    fn a_request_is_answered_with_masks_and_pictures_and_a_stroke_at_once() {
        let dataset = Arc::new(test_capture::dataset());
        let finder = Finder::new(Arc::clone(&dataset), test_capture::place(), || ());
        let finder = finder.expect("threads");
        let until = |is_it: &dyn Fn(&News) -> bool| {
            let mut news = Vec::new();
            while !news.last().is_some_and(is_it) {
                let next = finder.news.recv_timeout(Duration::from_mins(2));
                news.push(next.expect("more comes"));
            }
            news
        };
        let is_rest = |news: &News| matches!(news, News::Rest);
        until(&is_rest);
        let mut request = Request {
            selection: Selection::default(),
            strokes: Vec::new(),
            view: 3,
        };
        finder.ask(request.clone());
        let news = until(&is_rest);
        let has = |what: &dyn Fn(&News) -> bool| news.iter().filter(|news| what(news)).count();
        assert_eq!(
            has(&|news| matches!(news, News::Found(found, _) if found.masks.len() == 14)),
            1
        );
        assert_eq!(has(&|news| matches!(news, News::Outlined(3, _))), 1);
        assert_eq!(has(&|news| matches!(news, News::Shape(3, _))), 1);
        assert_eq!(has(&|news| matches!(news, News::Thumbnail(..))), 14);
        request.strokes.push(Stroke {
            view: 3,
            places: vec![glam::Vec2::splat(48.0)],
            radius: 4.0,
            adds: false,
        });
        finder.ask(request.clone());
        let news = until(&|news| matches!(news, News::Found(..)));
        let first = news.iter().find(|news| !matches!(news, News::Busy(..)));
        assert!(
            matches!(first, Some(News::Outlined(3, _))),
            "before the others"
        );
        assert!(matches!(news.last(), Some(News::Found(_, heard)) if *heard == request.strokes));
    }
}
