//! The subscribing side: in each iteration all that every topic's reader has, printed.

use std::collections::HashMap;

use rtps_socket::{
    ContentFilteredTopic, DataReader, DomainParticipant, KeyHash, Sample, Selection, Subscriber,
    Topic,
};

use crate::Failure;
use crate::interrupt::Interrupt;
use crate::options::Options;
use crate::output::Printer;
use crate::shape::ShapeType;
use crate::{qos, report};

/// Everything that a subscriber reads with.
pub(crate) struct ShapeSubscriber<'a> {
    options: &'a Options,
    interrupt: &'a Interrupt,
    printer: &'a Printer,
    subscriber: Subscriber,
    readers: Vec<TopicReader>,
}

struct TopicReader {
    /// Of the topic, or the content-filtered topic.
    name: String,
    reader: DataReader<ShapeType>,
    /// Of the instances that were seen: the news of their end may come without.
    colors: HashMap<KeyHash, String>,
}

impl<'a> ShapeSubscriber<'a> {
    /// Creates topics, subscriber and readers, and says so before each.
    pub(crate) fn new(
        options: &'a Options,
        participant: &DomainParticipant,
        interrupt: &'a Interrupt,
        printer: &'a Printer,
    ) -> Result<Self, Failure> {
        let topics = crate::topics(options, participant, printer)?;
        let subscriber = participant.create_subscriber(qos::group(options));
        let readers = topics.iter().map(|topic| {
            let filtered = filtered(options, participant, topic)?;
            TopicReader::new(options, &subscriber, topic, filtered, printer)
        });
        Ok(Self {
            readers: readers.collect::<Result<_, _>>()?,
            options,
            interrupt,
            printer,
            subscriber,
        })
    }

    /// Reads until the last iteration or the interrupt.
    pub(crate) fn run(&mut self) {
        let mut iteration = 0;
        while !self.interrupt.is_raised() {
            self.announce(iteration);
            let access = self.options.has_presentation();
            let access = access.then(|| self.subscriber.begin_access());
            for reader in &mut self.readers {
                reader.access(self.options, self.printer);
            }
            drop(access);
            iteration += 1;
            if self.options.iterations == Some(iteration) {
                break;
            }
            self.interrupt.sleep(self.options.subscriber.period);
        }
    }

    fn announce(&self, iteration: u64) {
        if self.options.qos.is_coherent {
            let line = format!("Reading coherent sets, iteration {iteration}");
            self.printer.print_patiently(line);
        }
        if self.options.qos.is_ordered {
            let line = format!("Reading with ordered access, iteration {iteration}");
            self.printer.print_patiently(line);
        }
    }
}

/// What the options want of a topic, where that is not all.
fn filtered(
    options: &Options,
    participant: &DomainParticipant,
    topic: &Topic<ShapeType>,
) -> Result<Option<ContentFilteredTopic<ShapeType>>, Failure> {
    let create = |expression: &str, parameters: &[&str]| {
        let name = format!("{}_filtered", topic.name());
        participant.create_content_filtered_topic(&name, topic, expression, parameters)
    };
    let filtered = match (&options.color, &options.subscriber.filter) {
        // In quotes, as most vendors have it.
        (Some(color), _) => create("color = %0", &[&format!("'{color}'")])?,
        (None, Some(expression)) => create(expression, &[])?,
        (None, None) => return Ok(None),
    };
    Ok(Some(filtered))
}

impl TopicReader {
    /// Creates the reader, and says so before.
    fn new(
        options: &Options,
        subscriber: &Subscriber,
        topic: &Topic<ShapeType>,
        filtered: Option<ContentFilteredTopic<ShapeType>>,
        printer: &Printer,
    ) -> Result<Self, Failure> {
        let filtered_name = filtered.as_ref().map(ContentFilteredTopic::name);
        let name = filtered_name.unwrap_or_else(|| topic.name()).to_owned();
        printer.print(format!("Create reader for topic: {name}"));
        let qos = qos::reader(options);
        Ok(Self {
            name,
            reader: match filtered {
                Some(filtered) => subscriber.create_reader(&filtered, qos)?,
                None => subscriber.create_reader(topic, qos)?,
            },
            colors: HashMap::new(),
        })
    }

    /// Prints all that there is.
    fn access(&mut self, options: &Options, printer: &Printer) {
        let mut previous = None;
        loop {
            let samples = self.next(options, previous);
            let Some(first) = samples.first() else {
                return;
            };
            previous = Some(first.info.instance);
            for sample in &samples {
                self.print(sample, printer);
            }
        }
    }

    /// The next samples in the form that the options ask for; none at the end.
    fn next(&self, options: &Options, previous: Option<KeyHash>) -> Vec<Sample<ShapeType>> {
        let (reader, any) = (&self.reader, Selection::default());
        match (options.subscriber.is_plain, options.subscriber.reads) {
            (false, false) => reader.take_next_instance(previous, usize::MAX, &any),
            (false, true) => reader.read_next_instance(previous, usize::MAX, &any),
            (true, false) => reader.take(),
            // Reading in any sample state would never end.
            (true, true) => reader.read(),
        }
    }

    fn print(&mut self, sample: &Sample<ShapeType>, printer: &Printer) {
        let instance = sample.info.instance;
        if let Some(shape) = sample.data_or_key() {
            let known = self.colors.entry(instance);
            known.or_insert_with(|| shape.color.clone());
        }
        if let Some(shape) = &sample.data {
            printer.print_patiently(report::sample(&self.name, shape));
        }
        let color = self.colors.get(&instance);
        let gone =
            color.and_then(|color| report::gone(&self.name, color, sample.info.instance_state));
        if let Some(line) = gone {
            printer.print_patiently(line);
        }
    }
}
