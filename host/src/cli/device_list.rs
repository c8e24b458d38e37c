//! `whirl device list`: serial ports, and the boards that answer on them.
//!
//! Only ports of makers whose boards whirl knows are asked, and one named with `--from`: to other
//! devices a strange byte may mean something.

use serde::Serialize;
use serialport::{SerialPortInfo, SerialPortType};

use super::Answer;
use super::device::{Device, Link};
use crate::capture::talk::Talk;
use crate::error::{BadInput, Result, plain};

/// USB vendors whose ports may be a board's: ST (the ST-LINK of a NUCLEO), Raspberry Pi, pid.codes,
/// and the id that embassy's examples use.
const VENDORS: [u16; 4] = [0x0483, 0x2e8a, 0x1209, 0xc0de];
/// How long a port that was not named may take for an answer, s.
const SHORT_S: f64 = 1.5;

/// A port.
#[derive(Debug, Serialize)]
struct Port {
    from: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    usb: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<Device>,
    /// Why no device is told of.
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
}

/// Serial ports of this computer, by name.
fn ports() -> Result<Vec<SerialPortInfo>> {
    let mut ports = serialport::available_ports().map_err(|e| {
        BadInput::new(e.to_string(), "the serial ports of this computer").remedy("Name the port with --from")
    })?;
    ports.sort_by(|a, b| a.port_name.cmp(&b.port_name));
    Ok(ports)
}

/// What stands behind a port, where it is USB.
fn usb(port: &SerialPortInfo) -> Option<(u16, String)> {
    let SerialPortType::UsbPort(usb) = &port.port_type else { return None };
    let words: Vec<String> = [&usb.manufacturer, &usb.product, &usb.serial_number]
        .into_iter()
        .filter_map(|word| word.as_deref().map(plain))
        .collect();
    Some((usb.vid, format!("{} ({:04x}:{:04x})", words.join(", "), usb.vid, usb.pid)))
}

/// Whether a port may be a board's.
fn may_be_a_board(port: &SerialPortInfo) -> bool {
    usb(port).is_some_and(|(vendor, _)| VENDORS.contains(&vendor))
}

/// The source of the one board that is plugged in.
///
/// # Errors
/// None, or several.
pub(super) fn only_one() -> Result<String> {
    let names: Vec<String> =
        ports()?.iter().filter(|p| may_be_a_board(p)).map(|p| format!("serial:{}", p.port_name)).collect();
    match &names[..] {
        [one] => Ok(one.clone()),
        [] => Err(BadInput::new("no port of a board", "a board that is plugged in")
            .at("--from")
            .remedy("Plug it in by USB, or name it: --from serial:/dev/ttyACM0; `whirl device list` shows the ports")),
        several => Err(BadInput::new(several.join(", "), "one of them")
            .at("--from")
            .remedy("Name the board with --from; `whirl device list` shows which is which")),
    }
}

/// Lists.
pub fn run(link: &Link) -> Result<Answer> {
    let rig = link.rig()?;
    let answer = |from: &str, patience_s: f64| {
        Talk::open(from, &rig, patience_s).and_then(|mut talk| talk.hello()).map(|hello| Device::of(&hello))
    };
    let mut list = Vec::new();
    if let Some(from) = &link.from {
        // What was named is to be there.
        let device = answer(from, link.handshake_s)?;
        list.push(Port { from: from.clone(), usb: None, device: Some(device), why: None });
    }
    for port in ports()? {
        let from = format!("serial:{}", port.port_name);
        if link.from.as_deref().is_some_and(|named| named.split('@').next() == Some(&from)) {
            continue;
        }
        let (device, why) = if may_be_a_board(&port) {
            match answer(&from, SHORT_S) {
                Ok(device) => (Some(device), None),
                Err(e) => (None, Some(e.found)),
            }
        } else {
            (
                None,
                Some(
                    "not asked, since whirl knows no boards of this port's maker (--from PORT asks it all the same)"
                        .to_owned(),
                ),
            )
        };
        list.push(Port { from, usb: usb(&port).map(|(_, text)| text), device, why });
    }
    let out = link.out();
    out.write_json(&serde_json::json!({ "ports": list, "warnings": [] }))?;
    out.say(&human(&list));
    Ok(Answer::Positive)
}

fn human(list: &[Port]) -> String {
    if list.is_empty() {
        return "no serial port is there: plug a board in by USB; on Linux see that you are in the group dialout\n"
            .to_owned();
    }
    let mut text = String::new();
    for port in list {
        let what = match (&port.device, &port.why) {
            (Some(device), _) => device.words(),
            (None, why) => format!("no board found: {}", plain(why.as_deref().unwrap_or_default())),
        };
        let usb = port.usb.as_ref().map_or_else(String::new, |usb| format!("  {usb}"));
        text.push_str(&format!("{:<24}{usb}  {what}\n", plain(&port.from)));
    }
    text
}
