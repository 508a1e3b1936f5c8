//! Tokens as GNU `getopt_long` takes them: clustered short options, attached and separate values, unambiguous
//! prefixes of long options, words that belong to none ignored.

use std::ffi::OsString;
use std::time::Duration;

use lexopt::Arg;
use rtps_socket::qos::{Durability, History, PresentationScope};
use thiserror::Error;

use super::check::{self, Inconsistent};
use super::{FinalState, Options, Request, Role};

/// The long options, of which a prefix is enough.
const LONG: [&str; 19] = [
    "help",
    "write-period",
    "read-period",
    "time-filter",
    "lifespan",
    "num-iterations",
    "num-instances",
    "num-topics",
    "final-instance-state",
    "access-scope",
    "coherent",
    "ordered",
    "coherent-sample-count",
    "additional-payload-size",
    "take-read",
    "periodic-announcement",
    "datafrag-size",
    "cft",
    "size-modulo",
];

/// What is wrong with a command line.
#[derive(Debug, Error)]
pub(crate) enum UsageError {
    #[error(transparent)]
    Token(#[from] lexopt::Error),
    #[error("--{0} is the beginning of several options")]
    Ambiguous(String),
    #[error("{option} takes {wanted}, which {value:?} is not")]
    Illegal {
        option: &'static str,
        wanted: &'static str,
        value: String,
    },
    #[error("--final-instance-state is either u or d, not both")]
    TwoFinalStates,
    #[error(transparent)]
    Inconsistent(#[from] Inconsistent),
}

/// Reads a command line without the program's name.
pub(crate) fn parse(
    arguments: impl IntoIterator<Item = impl Into<OsString>>,
) -> Result<Request, UsageError> {
    let mut tokens = lexopt::Parser::from_args(arguments);
    tokens.set_short_equals(false);
    let mut line = CommandLine::default();
    while let Some(token) = tokens.next()? {
        let option = match token {
            Arg::Value(_) => continue,
            Arg::Short(letter) => Token::Short(letter),
            Arg::Long(name) => Token::Long(complete(name)?),
        };
        match option {
            Token::Short('h') | Token::Long("help") => return Ok(Request::Help),
            Token::Short(letter) => line.short(letter, &mut tokens)?,
            Token::Long(name) => line.long(name, &mut tokens)?,
        }
    }
    let (options, warnings) = check::check(line.options, &line.roles)?;
    Ok(Request::Run(Box::new(options), warnings))
}

enum Token {
    Short(char),
    Long(&'static str),
}

/// The option that `name` is or begins.
fn complete(name: &str) -> Result<&'static str, UsageError> {
    if let Some(exact) = LONG.into_iter().find(|long| *long == name) {
        return Ok(exact);
    }
    let mut candidates = LONG.into_iter().filter(|long| long.starts_with(name));
    match (candidates.next(), candidates.next()) {
        (Some(only), None) => Ok(only),
        (Some(_), Some(_)) => Err(UsageError::Ambiguous(name.to_owned())),
        (None, _) => Err(Arg::Long(name).unexpected().into()),
    }
}

/// What has been read so far.
#[derive(Default)]
struct CommandLine {
    options: Options,
    roles: Vec<Role>,
}

impl CommandLine {
    fn short(&mut self, letter: char, tokens: &mut lexopt::Parser) -> Result<(), UsageError> {
        let options = &mut self.options;
        match letter {
            'P' => self.roles.push(Role::Publisher),
            'S' => self.roles.push(Role::Subscriber),
            'b' => options.qos.is_reliable = false,
            'r' => options.qos.is_reliable = true,
            'w' => options.publisher.prints_samples = true,
            'R' => options.subscriber.reads = true,
            't' => options.topic = text(tokens)?,
            'c' => options.color = Some(text(tokens)?),
            'p' => options.partition = Some(text(tokens)?),
            'd' => options.domain = number("-d", 0, tokens)?.unsigned_abs(),
            'k' => options.qos.history = Some(history(tokens)?),
            'f' => options.qos.deadline = period("-f", tokens)?,
            's' => {
                let strength = number("-s", -1, tokens)?;
                options.qos.strength = (strength >= 0).then_some(strength);
            }
            'z' => options.publisher.shape_size = number("-z", 0, tokens)?,
            'v' => {
                let levels = [('e', false), ('d', true)];
                options.is_verbose = letter_of("-v", "e or d", levels, tokens)?;
            }
            'x' => {
                let versions = [('1', false), ('2', true)];
                options.qos.is_xcdr2 = letter_of("-x", "1 or 2", versions, tokens)?;
            }
            'D' => {
                let kinds = [
                    ('v', Durability::Volatile),
                    ('l', Durability::TransientLocal),
                    ('t', Durability::Transient),
                    ('p', Durability::Persistent),
                ];
                options.qos.durability = letter_of("-D", "v, l, t or p", kinds, tokens)?;
            }
            unknown => return Err(Arg::Short(unknown).unexpected().into()),
        }
        Ok(())
    }

    fn long(&mut self, name: &'static str, tokens: &mut lexopt::Parser) -> Result<(), UsageError> {
        let options = &mut self.options;
        let (qos, publisher) = (&mut options.qos, &mut options.publisher);
        match name {
            "coherent" => qos.is_coherent = true,
            "ordered" => qos.is_ordered = true,
            "take-read" => options.subscriber.is_plain = true,
            "cft" => options.subscriber.filter = Some(text(tokens)?),
            "write-period" => publisher.period = period(name, tokens)?.unwrap_or_default(),
            "read-period" => options.subscriber.period = period(name, tokens)?.unwrap_or_default(),
            "time-filter" => qos.minimum_separation = period(name, tokens)?,
            "lifespan" => qos.lifespan = period(name, tokens)?,
            "periodic-announcement" => options.announce_period = period(name, tokens)?,
            "num-iterations" => options.iterations = Some(count(name, 1, tokens)?.into()),
            "num-instances" => publisher.instances = count(name, 1, tokens)?,
            "num-topics" => options.topics = count(name, 1, tokens)?,
            "coherent-sample-count" => {
                publisher.set_iterations = Some(count(name, 2, tokens)?.into())
            }
            "additional-payload-size" => publisher.payload_size = count(name, 1, tokens)? as usize,
            "size-modulo" => publisher.size_modulo = Some(number(name, 1, tokens)?),
            "datafrag-size" => options.fragment_size = fragment_size(name, tokens)?,
            "final-instance-state" => {
                let states = [('u', FinalState::Unregistered), ('d', FinalState::Disposed)];
                let state = letter_of(name, "u or d", states, tokens)?;
                if publisher.final_state.is_some_and(|given| given != state) {
                    return Err(UsageError::TwoFinalStates);
                }
                publisher.final_state = Some(state);
            }
            _ => {
                let scopes = [
                    ('i', PresentationScope::Instance),
                    ('t', PresentationScope::Topic),
                    ('g', PresentationScope::Group),
                ];
                qos.scope = letter_of(name, "i, t or g", scopes, tokens)?;
            }
        }
        Ok(())
    }
}

fn text(tokens: &mut lexopt::Parser) -> Result<String, UsageError> {
    Ok(tokens.value()?.to_string_lossy().into_owned())
}

/// A number that is not below `least`.
fn number(
    option: &'static str,
    least: i32,
    tokens: &mut lexopt::Parser,
) -> Result<i32, UsageError> {
    let value = text(tokens)?;
    match leading_number(&value) {
        number if number >= least => Ok(number),
        _ => Err(UsageError::Illegal {
            option,
            wanted: match least {
                -1 => "a number from -1",
                0 => "a number from 0",
                1 => "a number from 1",
                _ => "a number from 2",
            },
            value,
        }),
    }
}

fn count(option: &'static str, least: i32, tokens: &mut lexopt::Parser) -> Result<u32, UsageError> {
    Ok(number(option, least, tokens)?.unsigned_abs())
}

/// Milliseconds; 0 is none.
fn period(
    option: &'static str,
    tokens: &mut lexopt::Parser,
) -> Result<Option<Duration>, UsageError> {
    let milliseconds = u64::from(count(option, 0, tokens)?);
    Ok((milliseconds > 0).then(|| Duration::from_millis(milliseconds)))
}

fn history(tokens: &mut lexopt::Parser) -> Result<History, UsageError> {
    Ok(match count("-k", 0, tokens)? {
        0 => History::KeepAll,
        depth => History::KeepLast(depth),
    })
}

/// Octets; 0 is none.
fn fragment_size(
    option: &'static str,
    tokens: &mut lexopt::Parser,
) -> Result<Option<u16>, UsageError> {
    let size = number(option, 0, tokens)?;
    match u16::try_from(size) {
        Ok(size) => Ok((size > 0).then_some(size)),
        Err(_) => Err(UsageError::Illegal {
            option,
            wanted: "a number up to 65535",
            value: size.to_string(),
        }),
    }
}

/// What the first letter of the value stands for.
fn letter_of<T, const N: usize>(
    option: &'static str,
    wanted: &'static str,
    meanings: [(char, T); N],
    tokens: &mut lexopt::Parser,
) -> Result<T, UsageError> {
    let value = text(tokens)?;
    let meaning = meanings
        .into_iter()
        .find(|(letter, _)| value.starts_with(*letter));
    match meaning {
        Some((_, meaning)) => Ok(meaning),
        None => Err(UsageError::Illegal {
            option,
            wanted,
            value,
        }),
    }
}

/// The number that `text` begins with, as `atoi` finds it: 0 where there is none.
fn leading_number(text: &str) -> i32 {
    let text = text.trim_start();
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let digits = digits.bytes().take_while(u8::is_ascii_digit);
    let magnitude = digits.fold(0i64, |number, digit| {
        (number * 10 + i64::from(digit - b'0')).min(i64::from(i32::MAX))
    });
    i32::try_from(sign * magnitude).unwrap_or(i32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(line: &str) -> Options {
        match parse(line.split_whitespace()) {
            Ok(Request::Run(options, _)) => *options,
            other => panic!("{line}: {other:?}"),
        }
    }

    fn error(line: &str) -> UsageError {
        parse(line.split_whitespace()).expect_err(line)
    }

    #[test]
    fn what_is_not_given_has_its_default() {
        let expected = Options {
            topic: "Square".to_owned(),
            ..Options::default()
        };
        assert_eq!(options("-S -t Square"), expected);
        let publisher = options("-P -t Square");
        assert_eq!(publisher.role, Role::Publisher);
        assert_eq!(publisher.color.as_deref(), Some("BLUE"));
    }

    #[test]
    fn short_options_are_clustered_and_values_attached() {
        let found = options("-PwbtCircle -z0 -k 4 -s-1 -s 7 -x2 -Dlocal");
        assert!(found.publisher.prints_samples && !found.qos.is_reliable && found.qos.is_xcdr2);
        assert_eq!(found.topic, "Circle");
        assert_eq!(found.publisher.shape_size, 0);
        assert_eq!(found.qos.history, Some(History::KeepLast(4)));
        assert_eq!(found.qos.strength, Some(7));
        assert_eq!(found.qos.durability, Durability::TransientLocal);
    }

    #[test]
    fn a_prefix_of_a_long_option_is_enough() {
        let found = options("-P -t T --write=5 --num-it 3 --coherent --coherent-s 2 --acc group");
        assert_eq!(found.publisher.period, Duration::from_millis(5));
        assert_eq!(found.iterations, Some(3));
        assert!(found.qos.is_coherent);
        assert_eq!(found.publisher.set_iterations, Some(2));
        assert_eq!(found.qos.scope, PresentationScope::Group);
        assert!(matches!(error("-P -t T --num 3"), UsageError::Ambiguous(_)));
        assert!(matches!(error("-P -t T --co 3"), UsageError::Ambiguous(_)));
    }

    #[test]
    fn the_last_value_wins_and_stray_words_are_ignored() {
        let found = options("stray -S -t A word -t B -b -r -c RED -c=X -- -P");
        assert_eq!(found.topic, "B");
        assert!(found.qos.is_reliable);
        assert_eq!(found.color.as_deref(), Some("=X"));
        assert_eq!(found.role, Role::Subscriber);
    }

    #[test]
    fn leading_digits_count() {
        let texts = ["12ms", " +7", "-3x", "x", "99999999999"];
        let numbers = texts.map(leading_number);
        assert_eq!(numbers, [12, 7, -3, 0, i32::MAX]);
        assert_eq!(options("-S -t T -d 5th").domain, 5);
    }

    #[test]
    fn zero_switches_off() {
        let found = options("-S -t T -f 100 -f 0 --time-filter 0 --datafrag-size 0 -k 0");
        assert_eq!(found.qos.deadline, None);
        assert_eq!(found.qos.minimum_separation, None);
        assert_eq!(found.fragment_size, None);
        assert_eq!(found.qos.history, Some(History::KeepAll));
    }

    #[test]
    fn illegal_values_are_refused() {
        for line in [
            "-d -1",
            "-k -1",
            "-f -1",
            "-s -2",
            "-z -1",
            "-D x",
            "-x 3",
            "-v x",
            "--access-scope x",
            "--write-period -1",
            "--num-iterations 0",
            "--num-instances 0",
            "--num-topics none",
            "--coherent-sample-count 1",
            "--additional-payload-size 0",
            "--size-modulo 0",
            "--datafrag-size 65536",
            "--final-instance-state x",
        ] {
            let error = error(&format!("-P -t T {line}"));
            assert!(matches!(error, UsageError::Illegal { .. }), "{line}");
        }
        let both = error("-P -t T --final-instance-state u --final-instance-state d");
        assert!(matches!(both, UsageError::TwoFinalStates));
    }

    #[test]
    fn unknown_options_and_missing_values_are_refused() {
        for line in ["-q", "--quick", "-t", "--cft", "--coherent=yes"] {
            let error = error(&format!("-P -t T {line}"));
            assert!(matches!(error, UsageError::Token(_)), "{line}");
        }
    }

    #[test]
    fn help_needs_nothing_else() {
        for line in ["-h", "-P --he", "-Ph"] {
            assert!(matches!(parse(line.split_whitespace()), Ok(Request::Help)));
        }
    }
}
