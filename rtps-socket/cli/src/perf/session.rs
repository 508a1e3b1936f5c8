//! A participant with ddsperf's endpoints: names, partitions and policies are its.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Result;
use rtps_socket::{EntityId, GuidPrefix, Qos, RawReader, RawWriter, RtpsSocket};

use super::options::Options;

/// What a reliable data writer and reader keep at most.
const MAX_SAMPLES: u32 = 10_000;
/// How long a write waits for room before there is a look at signals. Then it goes on waiting.
const MAX_BLOCKING_TIME: Duration = Duration::from_millis(250);
/// Pings and pongs of others than the one at hand must not push it out.
const PINGS_KEPT: u32 = 16;

/// The topics of each type.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Flow {
    /// Of publishers and subscribers.
    Data,
    /// Requests for an answer.
    Ping,
    /// Answers.
    Pong,
}

/// See the module.
pub(crate) struct Session {
    socket: RtpsSocket,
    options: Options,
    keep_last: Option<u32>,
}

impl Session {
    /// Joins the domain. Data is kept whole unless `keep_last` says how many samples of an instance.
    pub(crate) fn open(options: &Options, keep_last: Option<u32>) -> Result<Self> {
        Self::with_user_data(options, keep_last, "")
    }

    /// Joins the domain as a participant that ddsperf answers, and whose answers it waits for.
    pub(crate) fn open_to_ping(options: &Options) -> Result<Self> {
        let system = nix::sys::utsname::uname()?;
        let host = system.nodename().to_string_lossy();
        // Whether there is a reader of data, the process, and where it runs.
        let user_data = format!("DDSPerf:0:{}:{}", std::process::id(), host);
        Self::with_user_data(options, None, &user_data)
    }

    fn with_user_data(options: &Options, keep_last: Option<u32>, user_data: &str) -> Result<Self> {
        let mut builder = RtpsSocket::builder()
            .domain(options.domain)
            .layer(options.layer())
            .user_data(user_data);
        if let Some(micros) = options.busy_poll {
            builder = builder.busy_poll(Duration::from_micros(micros));
        }
        Ok(Self {
            socket: builder.open()?,
            options: options.clone(),
            keep_last,
        })
    }

    /// A writer; answers are written in the partition of who asked.
    pub(crate) fn writer(&self, flow: Flow, partition: Option<String>) -> Result<RawWriter> {
        let topic = self.options.topic;
        Ok(self.socket.create_writer(
            &self.topic_name(flow),
            topic.type_name(),
            self.qos(flow).partition(partition),
            topic.has_key(),
        )?)
    }

    /// A reader, as [`Session::writer`].
    pub(crate) fn reader(&self, flow: Flow, partition: Option<String>) -> Result<RawReader> {
        let topic = self.options.topic;
        Ok(self.socket.create_reader(
            &self.topic_name(flow),
            topic.type_name(),
            self.qos(flow).partition(partition),
            topic.instance_of(),
        )?)
    }

    fn topic_name(&self, flow: Flow) -> String {
        let reliability = match self.options.best_effort {
            true => 'U',
            false => 'R',
        };
        format!(
            "DDSPerf{reliability}{flow:?}{}",
            self.options.topic.suffix()
        )
    }

    fn qos(&self, flow: Flow) -> Qos {
        let qos = match self.options.best_effort {
            true => Qos::best_effort(),
            false => Qos::reliable().max_blocking_time(MAX_BLOCKING_TIME),
        };
        match (flow, self.keep_last) {
            (Flow::Ping | Flow::Pong, _) => qos.keep_last(PINGS_KEPT),
            (Flow::Data, Some(depth)) => qos.keep_last(depth),
            (Flow::Data, None) => qos
                .keep_all()
                .resource_limits(Some(MAX_SAMPLES), None, None),
        }
    }
}

/// The partition of the answers to a participant: its GUID.
pub(crate) fn partition_of(participant: GuidPrefix) -> String {
    let prefix = participant.0.chunks(4);
    let EntityId(entity) = EntityId::PARTICIPANT;
    let words = prefix.chain([&entity[..]]).map(|word| {
        let digits = word.iter().map(|byte| format!("{byte:02x}"));
        digits.collect::<String>()
    });
    words.collect::<Vec<_>>().join("_")
}

/// The time with its lowest bit set or not. In the source timestamp of a sample it says whether an answer is wanted, and
/// in that of an answer whether it is one to a ping.
pub(crate) fn marked(time: SystemTime, mark: bool) -> SystemTime {
    let since_epoch = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    let nanos = since_epoch.subsec_nanos() & !1 | u32::from(mark);
    UNIX_EPOCH + Duration::new(since_epoch.as_secs(), nanos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_partition_is_the_guid_in_words() {
        let prefix = GuidPrefix([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 0xab, 0xcd]);
        assert_eq!(partition_of(prefix), "01020304_05060708_090aabcd_000001c1");
    }

    #[test]
    fn a_mark_changes_nothing_but_the_lowest_bit() {
        let time = |nanos| UNIX_EPOCH + Duration::new(1_700_000_000, nanos);
        assert_eq!(marked(time(999_999_999), false), time(999_999_998));
        assert_eq!(marked(time(999_999_998), true), time(999_999_999));
        assert_eq!(marked(time(7), true), time(7));
    }
}
