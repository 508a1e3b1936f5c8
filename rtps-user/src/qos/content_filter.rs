//! The filter that a reader announces (ContentFilterProperty_t, RTPS 2.5 table 9.12 and section 9.6.3.4).

use md5::{Digest, Md5};
use serde::{Deserialize, Serialize};

use super::parameters::write_string;
use crate::wire::{Cursor, FilterSignature, ParameterId, ParameterWriter, WireError};

/// PID_CONTENT_FILTER_PROPERTY.
pub(crate) const CONTENT_FILTER_PROPERTY: ParameterId = ParameterId(0x0035);

/// The most parameters of an expression: `%0` to `%99` (DDS 1.4 annex B).
const MAX_PARAMETERS: usize = 100;

/// What a reader wants of its topic. A writer that understands it need not send the rest.
#[derive(Clone, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct ContentFilter {
    /// The name of the ContentFilteredTopic.
    pub name: String,
    /// The name of the topic that is filtered.
    pub related_topic: String,
    /// The language of the expression: `DDSSQL` is that of DDS 1.4 annex B.
    pub class: String,
    /// The expression.
    pub expression: String,
    /// What stands for `%0`, `%1` and so on.
    pub parameters: Vec<String>,
}

impl ContentFilter {
    /// The name of the language of DDS 1.4 annex B.
    pub const SQL: &'static str = "DDSSQL";

    /// The name of that language with MATCH as it is understood here, which others would take for something else.
    pub const SQL_WITH_FNMATCH: &'static str = "DDSSQL+FNMATCH";

    /// What writers name the filter by that have put samples to it (RTPS 2.5 section 9.6.4.1): the MD5 of all its texts,
    /// each with its NUL.
    pub fn signature(&self) -> FilterSignature {
        let texts = [
            &self.name,
            &self.related_topic,
            &self.class,
            &self.expression,
        ];
        let mut digest = Md5::new();
        for text in texts.into_iter().chain(&self.parameters) {
            digest.update(text);
            digest.update([0]);
        }
        FilterSignature(digest.finalize().into())
    }

    pub(crate) fn read(value: &mut Cursor<'_>) -> Result<Self, WireError> {
        let mut string = || value.string().map(str::to_owned);
        let (name, related_topic) = (string()?, string()?);
        let (class, expression) = (string()?, string()?);
        value.align(4)?;
        let count = usize::try_from(value.u32()?).map_err(|_| WireError::InvalidParameterList)?;
        if count > MAX_PARAMETERS {
            return Err(WireError::InvalidParameterList);
        }
        let parameters = (0..count).map(|_| value.string().map(str::to_owned));
        Ok(Self {
            parameters: parameters.collect::<Result<_, _>>()?,
            name,
            related_topic,
            class,
            expression,
        })
    }

    pub(crate) fn write(&self, list: &mut ParameterWriter<'_>) {
        list.parameter(CONTENT_FILTER_PROPERTY, |out| {
            let start = out.len();
            let align = |out: &mut Vec<u8>| {
                let aligned = (out.len() - start).next_multiple_of(4);
                out.resize(start + aligned, 0);
            };
            for text in [
                &self.name,
                &self.related_topic,
                &self.class,
                &self.expression,
            ] {
                align(out);
                write_string(text, out);
            }
            align(out);
            out.extend_from_slice(&(self.parameters.len() as u32).to_le_bytes());
            for text in &self.parameters {
                align(out);
                write_string(text, out);
            }
        });
    }
}
