// The program axis_linux: the axis as a real-time process with a drive on CANopen.
#include "firmware/port/linux/axis_linux.h"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/axis_linux/settings_format.hpp"
#include "host/program/program.hpp"
#include "sim/model/section.hpp"
#include "sim/model/toml.hpp"

namespace {

using namespace forceaxis;

// The values of a settings file. `config` has pointers into the other members.
struct Settings {
  axis_linux_config_t config{};
  std::string supervisor, drive, store, archive, device, buffer, channel;
  std::vector<drive402_entry_t> objects;
};

constexpr const char *kText = "expected a text in quotes";

template <typename Integer>
Integer whole(sim::Section &section, const char *key) {
  return static_cast<Integer>(section.integer(key));
}

using KeyOf = std::pair<std::uint16_t, std::string>;
#define FORCEAXIS_KEY(name, bit, key, what) KeyOf(bit, key),

void read_drive(sim::Section &section, Settings &settings) {
  drive402_config_t &drive = settings.config.drive;
  settings.drive = section.text("interface", kText);
  drive.node_id = whole<std::uint8_t>(section, "node_id");
  drive.own_node_id = whole<std::uint8_t>(section, "master_node_id");
  constexpr std::uint8_t kModes[] = {DRIVE402_CSV, DRIVE402_CST, DRIVE402_CSP};
  drive.mode = kModes[section.choice("mode", "choose a mode of the drive")];
  drive.scale_num = whole<std::uint32_t>(section, "target_num");
  drive.scale_den = whole<std::uint32_t>(section, "target_den");
  drive.scale_shift = AXIS_FINE_BITS;
  drive.target_max = section.integer("target_max");
  drive.cycle_ms = whole<std::uint8_t>(section, "cycle_ms");
  if (drive.cycle_ms % 2 != 0)
    section.fail("cycle_ms", "expected an even number of ms, because 2 ms are 3 ticks, got " +
                                 std::to_string(drive.cycle_ms));
  drive.rpdo_type = whole<std::uint8_t>(section, "rpdo_type");
  drive.heartbeat_ms = whole<std::uint16_t>(section, "heartbeat_ms");
  drive.heartbeat_timeout_ms = whole<std::uint16_t>(section, "heartbeat_timeout_ms");
  drive.sdo_timeout_ms = whole<std::uint16_t>(section, "sdo_timeout_ms");
  drive.wait_ms = whole<std::uint16_t>(section, "wait_ms");
  drive.quick_stop_ms = whole<std::uint16_t>(section, "quick_stop_ms");
  drive.abort_option = whole<std::int16_t>(section, "abort_option");
  for (const auto &[bit, key] : std::initializer_list<KeyOf>{DRIVE402_OBJECTS(FORCEAXIS_KEY)}) {
    if (section.flag("lacks_" + key)) drive.without |= bit;
  }
  for (const auto &[bit, key] : std::initializer_list<KeyOf>{DRIVE402_VALUES(FORCEAXIS_KEY)}) {
    if (section.flag("differs_" + key)) drive.differs |= bit;
  }
  section.each("object", [&](sim::Section &object) {
    const auto bytes = whole<std::uint8_t>(object, "bytes");
    if (bytes == 3) object.fail("bytes", "expected 1, 2 or 4, got 3");
    settings.objects.push_back({whole<std::uint16_t>(object, "index"),
                                whole<std::uint8_t>(object, "sub"), bytes,
                                whole<std::uint32_t>(object, "value")});
  });
}

void read_load_cell(sim::Section &section, load_cell_t &cell) {
  cell.identifier = whole<std::uint16_t>(section, "identifier");
  cell.byte = whole<std::uint8_t>(section, "byte");
  cell.bytes = whole<std::uint8_t>(section, "bytes");
  cell.shift = whole<std::uint8_t>(section, "shift");
  cell.is_signed = section.flag("signed");
  if (cell.byte + cell.bytes > 8)
    section.fail("bytes", "expected a force within the 8 bytes of a frame, got byte " +
                              std::to_string(cell.byte) + " and " + std::to_string(cell.bytes) +
                              " bytes");
}

void read_iio(sim::Section &section, Settings &settings) {
  iio_settings_t &iio = settings.config.iio;
  settings.device = section.text("device", kText);
  while (settings.device.ends_with('/')) settings.device.pop_back();
  settings.channel = section.text("channel", kText);
  settings.buffer =
      section.optional_text("buffer", kText)
          .value_or("/dev/" + std::filesystem::path(settings.device).filename().string());
  iio.shift = IIO_SHIFT_OWN;
  if (section.has("shift")) iio.shift = whole<std::uint8_t>(section, "shift");
  iio.device = settings.device.c_str();
  iio.buffer = settings.buffer.c_str();
  iio.channel = settings.channel.c_str();
}

void read_real_time(sim::Section &section, axis_linux_config_t &config) {
  config.priority = section.integer("priority");
  config.cpu = section.integer("cpu");
  config.late_ticks_max = whole<std::uint32_t>(section, "late_ticks_max");
}

void read(const std::string &file, Settings &settings) {
  const toml::table table = sim::parse_toml(file);
  sim::Source source{file, {}};
  sim::Section root(source, table, "", axis_linux::kSettingsFormat);
  axis_linux_config_t &config = settings.config;
  settings.supervisor = root.text("supervisor", kText);
  settings.store = root.optional_text("store", kText).value_or("");
  settings.archive = root.optional_text("archive", kText).value_or("");
  config.node_id = whole<std::uint8_t>(root, "node_id");
  if (!root.has("drive")) root.fail("drive", "expected a table [drive], got none");
  if (root.has("load_cell") == root.has("iio"))
    root.fail("load_cell", std::string("expected one of the tables [load_cell] and [iio], got ") +
                               (root.has("iio") ? "both" : "none"));
  root.one("drive", [&](sim::Section &section) { read_drive(section, settings); });
  root.one("load_cell", [&](sim::Section &section) { read_load_cell(section, config.load_cell); });
  root.one("iio", [&](sim::Section &section) { read_iio(section, settings); });
  config.priority = 80;
  config.cpu = -1;
  config.late_ticks_max = 3;
  root.one("real_time", [&](sim::Section &section) { read_real_time(section, config); });
  root.finish();
  const auto path = [](const std::string &text) { return text.empty() ? nullptr : text.c_str(); };
  config.supervisor_can = settings.supervisor.c_str();
  config.drive_can = settings.drive.c_str();
  config.store_path = path(settings.store);
  config.archive_path = path(settings.archive);
  config.drive.extra = settings.objects.data();
  config.drive.extra_count = static_cast<std::uint8_t>(settings.objects.size());
}

}  // namespace

int main(int argc, char **argv) {
  std::string file;
  std::uint32_t lateness_s = 0;
  CLI::App app(
      "Runs an axis as a real-time process: force control on a CiA 402 drive with a load cell on "
      "its CAN bus, or with a converter of this machine. The axis is a CANopen node on another CAN "
      "interface. SIGTERM stops the drive "
      "and ends the process, which then prints how late its ticks were.");
  app.add_option("SETTINGS", file, "TOML file with interfaces, drive and load cell.")->required();
  app.add_option("--lateness", lateness_s,
                 "Measure for this time in s how late the ticks of this machine are, without drive "
                 "and buses, with [real_time] of the settings.")
      ->check(CLI::Range(1U, 86400U));
  app.footer(
      "Example:\n  axis_linux axis.toml --lateness 600\n  axis_linux axis.toml\n  forceaxis axis "
      "status --on can0");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return nodes::refuse("axis_linux", app, error);
  }
  return nodes::guarded("axis_linux", [&]() -> int {
    // static, because the settings must exist as long as the process runs
    static Settings settings;
    read(file, settings);
    settings.config.lateness_s = lateness_s;
    throw nodes::UsageError(axis_linux_run(&settings.config));
  });
}
