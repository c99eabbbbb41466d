//! `std_srvs/srv/Trigger` on the wire, in the two forms that ROS 2's middlewares give a service.
//!
//! - **Fast DDS** (ROS 2's default, and RTI Connext): the message alone; which request an answer belongs to is said
//!   outside of it (`related_sample_identity` of RPC over DDS, "enhanced" mapping).
//! - **CycloneDDS**: 16 bytes in front of the message, made by the client and sent back by the server
//!   (`cdds_request_header_t` of rmw_cyclonedds).
//!
//! A Trigger's request has one byte, for ROS 2 leaves no message empty. So its length says which form a request has,
//! and an answer goes out in the form of its request. No setting is needed.

use tactile_data::error::Error as DataError;
use tactile_data::recording::ros::cdr;

/// The header of plain CDR, little endian.
const PLAIN: [u8; 4] = [0, 1, 0, 0];

/// Bytes that CycloneDDS puts in front.
pub(super) type CycloneHeader = [u8; 16];

/// Longest text of an answer that is believed, bytes.
const MAX_TEXT: usize = 1 << 16;

/// How a service's messages are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// The message alone.
    Plain,
    /// Behind CycloneDDS's header.
    Cyclone(CycloneHeader),
}

/// What a service does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Answer {
    pub(super) success: bool,
    pub(super) message: String,
}

/// The body of a message, which must be plain CDR, little endian.
fn body(cdr: &[u8]) -> Result<&[u8], String> {
    match cdr {
        [0, 1, _, _, body @ ..] => Ok(body),
        other => Err(format!("expected plain CDR, little endian, got {}", beginning(other))),
    }
}

/// The first bytes, for an error.
pub(super) fn beginning(bytes: &[u8]) -> String {
    let first: Vec<_> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
    format!("{} ({} bytes)", first.join(" "), bytes.len())
}

/// The form of a request.
pub(super) fn read_request(cdr: &[u8]) -> Result<Form, String> {
    let body = body(cdr)?;
    match body.len() {
        // The byte, and up to three that fill the message to a multiple of four.
        1..=4 => Ok(Form::Plain),
        16..=20 => Ok(Form::Cyclone(body.first_chunk().copied().unwrap_or_default())),
        n_bytes => Err(format!("expected 1 to 4 bytes of request, or 17 to 20 with a header, got {n_bytes}")),
    }
}

/// A request.
pub(super) fn write_request(form: Form) -> Vec<u8> {
    [&PLAIN[..], header(&form), &[0]].concat()
}

/// An answer and its CycloneDDS header, which it has if `is_cyclone`.
pub(super) fn read_answer(cdr: &[u8], is_cyclone: bool) -> Result<(Form, Answer), String> {
    let body = body(cdr)?;
    let (form, message) = match body.split_first_chunk::<16>() {
        Some((header, rest)) if is_cyclone => (Form::Cyclone(*header), rest),
        None if is_cyclone => return Err(format!("expected a header of 16 bytes, got {}", body.len())),
        _ => (Form::Plain, body),
    };
    if message.len() > MAX_TEXT {
        return Err(format!("expected an answer of at most {MAX_TEXT} bytes, got {}", message.len()));
    }
    let whole = [&PLAIN[..], message].concat();
    let read = || -> Result<Answer, DataError> {
        let mut reader = cdr::Reader::new(&whole, "Trigger's answer")?;
        Ok(Answer { success: reader.read("success")?, message: reader.read("message")? })
    };
    read().map(|answer| (form, answer)).map_err(|error| error.to_string())
}

/// An answer.
pub(super) fn write_answer(form: Form, answer: &Answer) -> Vec<u8> {
    let mut writer = cdr::Writer::default();
    cdr::Field::write(&answer.success, &mut writer);
    cdr::Field::write(&answer.message, &mut writer);
    let whole = writer.finish();
    // The header's 16 bytes move no alignment.
    [&PLAIN[..], header(&form), &whole[PLAIN.len()..]].concat()
}

fn header(form: &Form) -> &[u8] {
    match form {
        Form::Plain => &[],
        Form::Cyclone(header) => header,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: CycloneHeader = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16];

    /// As rmw_fastrtps and rmw_cyclonedds send it: one byte, filled up to four.
    #[test]
    fn a_requests_length_says_its_form() {
        assert_eq!(read_request(&[0, 1, 0, 0, 0]), Ok(Form::Plain));
        assert_eq!(read_request(&[0, 1, 0, 3, 0, 0, 0, 0]), Ok(Form::Plain));
        let cyclone = [&[0, 1, 0, 3][..], &HEADER, &[0, 0, 0, 0]].concat();
        assert_eq!(read_request(&cyclone), Ok(Form::Cyclone(HEADER)));
        assert_eq!(read_request(&cyclone[..21]), Ok(Form::Cyclone(HEADER)));
        for bad in [&[][..], &[0, 1, 0], &[0, 0, 0, 0, 0], &[0, 1, 0, 0], &[0, 1, 0, 0, 1, 2, 3, 4, 5], &[0; 100]] {
            assert!(read_request(bad).is_err(), "{bad:?}");
        }
        assert_eq!(write_request(Form::Plain), [0, 1, 0, 0, 0]);
        assert_eq!(write_request(Form::Cyclone(HEADER)), [&[0, 1, 0, 0][..], &HEADER, &[0]].concat());
    }

    #[test]
    fn an_answer_has_the_bytes_computed_by_hand() {
        let answer = Answer { success: true, message: "ok".into() };
        // bool, three bytes up to the u32, the length with its closing zero, the text.
        let body = [1, 0, 0, 0, 3, 0, 0, 0, b'o', b'k', 0];
        let plain = [&[0, 1, 0, 0][..], &body].concat();
        let cyclone = [&[0, 1, 0, 0][..], &HEADER, &body].concat();
        assert_eq!(write_answer(Form::Plain, &answer), plain);
        assert_eq!(write_answer(Form::Cyclone(HEADER), &answer), cyclone);
        assert_eq!(read_answer(&plain, false), Ok((Form::Plain, answer.clone())));
        assert_eq!(read_answer(&cyclone, true), Ok((Form::Cyclone(HEADER), answer)));
        for cut in 0..plain.len() {
            assert!(read_answer(&plain[..cut], false).is_err(), "{cut}");
            assert!(read_answer(&cyclone[..cut], true).is_err(), "{cut}");
        }
        let long = [&[0, 1, 0, 0, 1, 0, 0, 0, 0xff, 0xff, 0xff, 0xff][..], b"x"].concat();
        assert!(read_answer(&long, false).is_err());
    }
}
