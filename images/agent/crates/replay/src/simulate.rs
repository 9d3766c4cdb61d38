//! A simulated world in place of a bag: it gives the next messages, and receives the answers.
//!
//! Turn by turn: the world receives the stack's latest messages, and gives the next moment of
//! simulated time with the messages that belong to it. They go out as a lock-step play's do:
//! everybody has read the time before the first message, each message before the next, and the
//! answers that the steps ask for have come, or their deadline has passed, before the world has
//! its turn again.

use std::cell::RefCell;
use std::sync::Arc;

use bagpipe_graph::{Middleware, Outlet, Share, TopicInfo};
use bagpipe_log::{Connection, MessageEncoding, SchemaEncoding};

use crate::ReplayError;
use crate::answers::Answers;
use crate::plan::Plan;
use crate::play::{Pace, Player};
use crate::recorder::Recorder;
use crate::request::ReplayRequest;
use crate::watch::Watch;
use crate::world::{Moment, World};

/// The publisher of the world's messages in the recording.
const PUBLISHER: &str = "/bagpipe_simulator";

/// A topic of the world.
struct Spoken {
    connection: Arc<Connection>,
    recorded: bool,
}

/// One world's turns with the stack.
pub(crate) struct Turns<'a> {
    world: &'a mut dyn World,
    answers: &'a Answers,
    recorder: &'a Recorder,
    connections: Vec<Spoken>,
    before: Option<u64>,
}

impl<'a> Turns<'a> {
    pub(crate) fn new(
        world: &'a mut dyn World,
        answers: &'a Answers,
        recorder: &'a Recorder,
        plan: &Plan<'_>,
        request: &ReplayRequest,
    ) -> Turns<'a> {
        let hidden = world.unrecorded();
        let connections = plan.topics.iter().map(|info| Spoken {
            connection: Arc::new(own_connection(info, &*request.middleware)),
            recorded: !hidden.contains(&info.topic),
        });
        let connections = connections.collect();
        Turns { world, answers, recorder, connections, before: None }
    }

    /// Takes turns until the world ends.
    pub(crate) fn play<O: Outlet + ?Sized>(
        mut self,
        player: &mut Player<'_, O>,
        watch: &mut Watch<'_>,
    ) -> Result<Pace, ReplayError> {
        let begun = watch.now();
        while let Some(moment) = self.next(watch)? {
            self.show(&moment, player, watch)?;
        }
        Ok(Pace { last: self.before, took: watch.now().duration_since(begun), ..Pace::default() })
    }

    fn next(&mut self, watch: &mut Watch<'_>) -> Result<Option<Moment>, ReplayError> {
        watch.check()?;
        let latest = self.answers.take_latest();
        let watch = RefCell::new(watch);
        let next = self.world.next(latest, &|| watch.borrow_mut().must_stop());
        match next {
            // The watch knows why.
            Err(ReplayError::Cancelled(_)) if watch.borrow_mut().must_stop() => {
                Err(watch.borrow_mut().failure())
            }
            other => other,
        }
    }

    fn show<O: Outlet + ?Sized>(
        &mut self,
        moment: &Moment,
        player: &mut Player<'_, O>,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        if self.before.is_some_and(|before| before >= moment.time) {
            let before = self.before.unwrap_or_default();
            return Err(ReplayError::BadRequest(format!(
                "the simulator's time must advance: {} ns came after {before} ns",
                moment.time
            )));
        }
        self.before = Some(moment.time);
        player.advance(moment.time, watch)?;
        for (at, frame) in &moment.messages {
            let spoken = self.connections.get(*at).filter(|_| frame.len() >= 4);
            let Some(Spoken { connection, recorded }) = spoken else {
                return Err(ReplayError::BadRequest(format!(
                    "the simulator speaks on topic number {at}, and it has {}",
                    self.connections.len()
                )));
            };
            // Before it goes out: what answers it comes later in the recording's own order.
            if *recorded {
                self.recorder.keep(connection, &frame[4..]);
            }
            if connection.latching {
                player.publications()[*at].latch("", Share::Counted, frame);
            }
            player.say(*at, frame, Share::Counted, watch)?;
        }
        watch.reached = moment.time;
        Ok(())
    }
}

fn own_connection(info: &TopicInfo, middleware: &dyn Middleware) -> Connection {
    Connection {
        topic: info.topic.clone(),
        datatype: info.datatype.clone(),
        md5sum: info.md5sum.clone(),
        definition: info.definition.clone(),
        caller_id: Some(PUBLISHER.to_owned()),
        latching: info.latching,
        message_encoding: MessageEncoding::from_name(middleware.encoding()),
        schema_encoding: SchemaEncoding::from_name(middleware.schema_encoding()),
        ..Connection::default()
    }
}
