//! The publishing side: a shape that moves, written to every instance of every topic in each iteration.

use std::time::Duration;

use rtps_socket::error::{CreateError, WriteError};
use rtps_socket::{DataWriter, DomainParticipant, Publisher, Topic};

use crate::interrupt::Interrupt;
use crate::options::{FinalState, Options, numbered};
use crate::output::Printer;
use crate::shape::{Motion, ShapeType};
use crate::{qos, report};

/// How long each writer waits for its readers at the end.
const FAREWELL: Duration = Duration::from_secs(1);
/// What every octet of the additional payload is.
const FILLING: u8 = 0xFF;

/// Everything that a publisher writes with.
pub(crate) struct ShapePublisher<'a> {
    options: &'a Options,
    interrupt: &'a Interrupt,
    printer: &'a Printer,
    publisher: Publisher,
    writers: Vec<TopicWriter>,
    colors: Vec<String>,
}

struct TopicWriter {
    topic: String,
    writer: DataWriter<ShapeType>,
}

impl<'a> ShapePublisher<'a> {
    /// Creates topics, publisher and writers, and says so before each.
    pub(crate) fn new(
        options: &'a Options,
        participant: &DomainParticipant,
        interrupt: &'a Interrupt,
        printer: &'a Printer,
    ) -> Result<Self, CreateError> {
        let topics = crate::topics(options, participant, printer)?;
        let publisher = participant.create_publisher(qos::group(options));
        let color = options.color.as_deref().unwrap_or_default();
        let writers = topics.iter().map(|topic| {
            let name = topic.name();
            printer.print(format!("Create writer for topic: {name} color: {color}"));
            TopicWriter::new(&publisher, topic, options)
        });
        Ok(Self {
            writers: writers.collect::<Result<_, _>>()?,
            colors: (0..options.publisher.instances)
                .map(|number| numbered(color, number))
                .collect(),
            options,
            interrupt,
            printer,
            publisher,
        })
    }

    /// Writes until the last iteration or the interrupt, then ends the instances as asked.
    pub(crate) fn run(&self) -> Result<(), WriteError> {
        let mut motion = Motion::new(&self.options.publisher);
        let mut shape = ShapeType {
            color: String::new(),
            x: 0,
            y: 0,
            shapesize: 0,
            additional_payload_size: vec![FILLING; self.options.publisher.payload_size],
        };
        let mut iteration = 0;
        while !self.interrupt.is_raised() {
            motion.advance(&mut shape);
            self.begin_set(iteration);
            self.write_all(&mut shape)?;
            self.end_set(iteration);
            self.interrupt.sleep(self.options.publisher.period);
            iteration += 1;
            if self.options.iterations == Some(iteration) {
                break;
            }
        }
        self.end_instances(&mut shape)?;
        for TopicWriter { writer, .. } in &self.writers {
            // A reader that does not keep up is its own problem.
            let _ = writer.wait_for_acknowledgments(FAREWELL);
        }
        Ok(())
    }

    fn write_all(&self, shape: &mut ShapeType) -> Result<(), WriteError> {
        for writer in &self.writers {
            for color in &self.colors {
                shape.color.clone_from(color);
                let is_written = self.until_there_is_room(|| writer.writer.write(shape))?;
                if is_written && self.options.publisher.prints_samples {
                    self.printer
                        .print_patiently(report::sample(&writer.topic, shape));
                }
            }
        }
        Ok(())
    }

    /// Begins a coherent set where one is due.
    fn begin_set(&self, iteration: u64) {
        if self
            .place_in_set(iteration)
            .is_some_and(|(place, _)| place == 0)
        {
            self.printer.print("Started Coherent Set");
            self.publisher.begin_coherent_changes();
        }
    }

    /// Ends the coherent set behind its last iteration.
    fn end_set(&self, iteration: u64) {
        let place = self.place_in_set(iteration);
        if place.is_some_and(|(place, iterations)| place + 1 == iterations) {
            self.printer.print("Finished Coherent Set");
            self.publisher.end_coherent_changes();
        }
    }

    /// Where an iteration is within its set, and how many the set has.
    fn place_in_set(&self, iteration: u64) -> Option<(u64, u64)> {
        let iterations = self.options.publisher.set_iterations?;
        let has_sets = self.options.has_presentation();
        has_sets.then(|| (iteration % iterations, iterations))
    }

    fn end_instances(&self, shape: &mut ShapeType) -> Result<(), WriteError> {
        let Some(state) = self.options.publisher.final_state else {
            return Ok(());
        };
        for TopicWriter { writer, .. } in &self.writers {
            for color in &self.colors {
                shape.color.clone_from(color);
                self.until_there_is_room(|| match state {
                    FinalState::Unregistered => writer.unregister(shape),
                    FinalState::Disposed => writer.dispose(shape),
                })?;
            }
        }
        Ok(())
    }

    /// Repeats what a slow reader holds up, until the interrupt; whether it was done.
    fn until_there_is_room<T>(
        &self,
        mut change: impl FnMut() -> Result<T, WriteError>,
    ) -> Result<bool, WriteError> {
        loop {
            match change() {
                Ok(_) => return Ok(true),
                Err(WriteError::Timeout) if self.interrupt.is_raised() => return Ok(false),
                Err(WriteError::Timeout) => {}
                Err(error) => return Err(error),
            }
        }
    }
}

impl TopicWriter {
    fn new(
        publisher: &Publisher,
        topic: &Topic<ShapeType>,
        options: &Options,
    ) -> Result<Self, CreateError> {
        Ok(Self {
            topic: topic.name().to_owned(),
            writer: publisher.create_writer(topic, qos::writer(options))?,
        })
    }
}
