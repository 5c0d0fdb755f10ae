// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "client/app/pacer.h"
#include "client/app/parse_exit.h"
#include "client/capture/imu_source.h"
#include "client/rig/commander.h"
#include "client/tracking/tracker_options.h"

namespace cairn {

/// The words of `cairn-track`, checked.
struct TrackOptions {
  std::string source;
  std::string config;                                ///< file of settings that was read; empty: none
  std::optional<std::filesystem::path> calibration;  ///< nothing: the source's own, or camera.txt beside it
  bool find_camera = false;   ///< --calibration auto: it is calibrated, from `calibration` if that is given
  bool exact_camera = false;  ///< --calibration exact:FILE: taken as it is, also without distortion
  /// The file to which a camera that was calibrated is written; nothing: a file of the client's name.
  std::optional<std::filesystem::path> saved_calibration;
  std::string server = "localhost";
  int domain = 0;
  std::string profile;   ///< empty: loopback for localhost, wifi otherwise
  std::string listen;    ///< interface or address of this machine; empty: that of the route to the server
  std::string security;  ///< folder of the client's keys; empty: an open site
  std::string name;
  std::string wearer;        ///< who wears the camera; empty: nobody in particular
  bool reader = false;       ///< --role reader: makes neither maps nor keyframes
  bool proposes = true;      ///< not --no-proposals: the server may keep keyframes aside
  bool no_new_maps = false;  ///< keyframes only
  std::string map;           ///< name of the only map to track in, for those who make none; empty: any
  int lost_patience = 1;     ///< [s] lost where no map is known, after which a builder begins one
  Pace pace = Pace::kRealtime;
  uint64_t seed = 1;
  bool headless = false;
  std::optional<std::filesystem::path> trajectory;
  std::optional<std::filesystem::path> stats;
  std::optional<std::filesystem::path> video;
  std::optional<std::filesystem::path> labels;  ///< to be placed at given times, without a window
  std::string rig;                              ///< name of the rig that carries the camera; empty: none
  RigAim rig_aim = RigAim::kFollow;
  wire::RigSearchPattern rig_search = wire::RigSearchPattern::kSpiral;
  std::string fixated_label;  ///< text; empty: what is in the middle of the image
  ImuRequest imu;
  TrackerOptions tracker;      ///< its constants, by a configuration file; what is to be made is said above
  CommanderOptions commander;  ///< likewise, of the one who commands the rig
  int verbosity = 0;           ///< as make_logger()

  [[nodiscard]] bool makes_maps() const { return !reader && !no_new_maps; }
};

/// Reads the command line (`arguments` without the program's name) and the file that --config names; the
/// command line wins. With --print-config the result is the configuration so resolved and checked, on stdout;
/// it needs no --source. A fault is told as that of the command line, of the file, or of both together.
/// `host_name` and `process_id` make the default client name.
[[nodiscard]] std::variant<TrackOptions, ParseExit> parse_track_options(std::vector<std::string> arguments,
                                                                        std::string_view host_name,
                                                                        int process_id);

/// A valid client name from a host name and a process id: "<host>-<pid>", what does not fit [a-z0-9-]{1,32}
/// replaced or cut.
[[nodiscard]] std::string default_client_name(std::string_view host_name, int process_id);

}  // namespace cairn
