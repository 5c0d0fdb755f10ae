// SPDX-License-Identifier: Apache-2.0
#include "client/capture/imu_source.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "client/capture/image_list_source.h"
#include "client/capture/imu_file.h"
#include "client/capture/source_uri.h"
#include "common/io/sensor_yaml.h"
#include "common/io/text.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMountRemedy =
    "pass --imu-mount: `qx,qy,qz,qw` that turns the IMU's axes to the camera's (x right, y down, z forward), "
    "Kalibr's camchain with T_cam_imu, or the camera's sensor.yaml with T_BS";

bool is_file(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

/// Beside the images of a source.
std::optional<fs::path> find_samples(const SourceUri& uri) {
  std::vector<fs::path> candidates;
  const fs::path path(uri.path);
  if (uri.scheme == "euroc") candidates = {euroc_camera_folder(uri).parent_path() / "imu0" / "data.csv"};
  if (uri.scheme == "tum") candidates = {path / "imu.csv", path / "imu.txt", path / "imu0" / "data.csv"};
  for (const auto& candidate : candidates) {
    if (is_file(candidate)) return candidate;
  }
  return std::nullopt;
}

/// The camera's sensor.yaml of a source.
std::optional<fs::path> find_camera_mount(const SourceUri& uri) {
  if (uri.scheme != "euroc") return std::nullopt;
  const auto file = euroc_camera_folder(uri) / "sensor.yaml";
  return is_file(file) ? std::optional(file) : std::nullopt;
}

std::optional<Eigen::Quaterniond> parse_quaternion(std::string_view text) {
  const auto fields = split_fields(text);
  if (fields.size() != 4) return std::nullopt;
  Eigen::Vector4d q;
  for (int i = 0; i < 4; ++i) {
    const auto number = parse_number(fields[static_cast<size_t>(i)]);
    if (!number) return std::nullopt;
    q[i] = *number;
  }
  constexpr double kRounding = 1e-2;
  if (std::abs(q.norm() - 1) > kRounding) return std::nullopt;
  return Eigen::Quaterniond(q).normalized();
}

/// T_BS of a sensor.yaml, if that is of such a sensor.
Result<std::optional<SE3>> body_from(const char* sensor, const fs::path& file) {
  const auto mount = read_sensor_mount(file);
  if (!mount) return tl::unexpected(mount.error());
  if (!*mount) return std::nullopt;
  if (!(*mount)->may_be(sensor)) {
    return fail(ErrorCode::kConfiguration,
                fmt::format("{}: is of a sensor of the type '{}', where that of the "
                            "{} is needed; {}",
                            file.string(), (*mount)->type, sensor, kMountRemedy));
  }
  return (*mount)->body_from_sensor;
}

/// The IMU's pose in the body, by the sensor.yaml beside the samples; the body's own frame where there is
/// none.
Result<SE3> body_from_imu(const fs::path& samples) {
  const auto file = samples.parent_path() / "sensor.yaml";
  if (!is_file(file)) return SE3();
  return body_from("imu", file).map([](const std::optional<SE3>& mount) { return mount.value_or(SE3()); });
}

/// The IMU's mount as a file says it; nothing where the file does not say it.
Result<std::optional<ImuMount>> mount_of_file(const fs::path& file, const fs::path& samples) {
  const auto kalibr = read_kalibr_imu(file);
  if (!kalibr) return tl::unexpected(kalibr.error());
  if (*kalibr) {
    return ImuMount{(*kalibr)->camera_from_imu.rotation(),
                    std::chrono::nanoseconds(std::llround(-1e9 * (*kalibr)->time_shift))};
  }
  const auto camera = body_from("camera", file);
  if (!camera) return tl::unexpected(camera.error());
  if (!*camera) return std::nullopt;
  const auto imu = body_from_imu(samples);
  if (!imu) return tl::unexpected(imu.error());
  return ImuMount{((*camera)->inverse() * *imu).rotation(), {}};
}

Result<std::optional<ImuMount>> find_mount(const SourceUri& uri, const ImuRequest& request,
                                           const fs::path& samples) {
  if (const auto quaternion = parse_quaternion(request.mount)) return ImuMount{*quaternion, {}};
  const bool is_asked = !request.mount.empty();
  const auto file = is_asked ? std::optional<fs::path>(request.mount) : find_camera_mount(uri);
  if (!file) return std::nullopt;
  auto mount = mount_of_file(*file, samples);
  if (!mount && mount.error().code == ErrorCode::kNotFound)
    return fail(ErrorCode::kConfiguration, fmt::format("{}; {}", mount.error().message, kMountRemedy));
  if (mount && !*mount && is_asked) {
    return fail(ErrorCode::kConfiguration,
                fmt::format("{}: says not how the IMU sits; {}", file->string(), kMountRemedy));
  }
  return mount;
}

Status check_span(const fs::path& file, const std::vector<ImuSample>& samples, const ImuMount& mount,
                  const FrameSource& source) {
  const auto frames = source.time_span();
  if (!frames) return {};
  const Timestamp first = samples.front().time + mount.clock_offset;
  const Timestamp last = samples.back().time + mount.clock_offset;
  if (first < frames->second && last > frames->first) return {};
  return fail(ErrorCode::kDamaged,
              fmt::format("{}: its samples are of {:.3f} to {:.3f} s, the frames of {:.3f} to {:.3f} s: none "
                          "goes with a frame; both must be stamped by the same clock, or "
                          "--imu-time-offset SECONDS says what the IMU's lacks",
                          file.string(), first.seconds(), last.seconds(), frames->first.seconds(),
                          frames->second.seconds()));
}

}  // namespace

Result<OpenedImu> open_imu(std::string_view text, FrameSource& source, const ImuRequest& request) {
  const auto uri = parse_source_uri(text);
  if (!uri) return tl::unexpected(uri.error());
  const bool is_asked = request.samples.has_value();
  if (is_asked && source.is_live())
    return fail(ErrorCode::kUsage, "--imu: its samples go with a recording, not with a live camera");
  std::error_code ignored;
  auto file = is_asked ? request.samples : find_samples(*uri);
  if (file && fs::is_directory(*file, ignored)) file = *file / "data.csv";
  if (!file) {
    if (!request.mount.empty() || request.clock_offset)
      return fail(ErrorCode::kUsage,
                  "--imu-mount, --imu-time-offset: there are no samples of an IMU; pass --imu");
    return OpenedImu{source.take_imu(), {}};
  }
  // What nobody asked for keeps no recording from being played.
  const auto refuse = [](bool was_asked, const Error& error) -> Result<OpenedImu> {
    if (was_asked) return tl::unexpected(error);
    return OpenedImu{nullptr, {{error.message + "; so the IMU is not used", true}}};
  };
  const auto found = find_mount(*uri, request, *file);
  if (!found) return refuse(is_asked || !request.mount.empty(), found.error());
  if (!*found) {
    const auto why = fmt::format("{}: it is not known how this IMU sits to the camera", file->string());
    if (is_asked) return fail(ErrorCode::kConfiguration, fmt::format("{}; {}", why, kMountRemedy));
    return OpenedImu{nullptr, {{fmt::format("{}, so it is not used; {}", why, kMountRemedy), false}}};
  }
  ImuMount mount = **found;
  if (request.clock_offset) mount.clock_offset = *request.clock_offset;
  auto samples = read_imu_file(*file);
  if (!samples) return refuse(is_asked, samples.error());
  if (auto status = check_span(*file, *samples, mount, source); !status)
    return refuse(is_asked, status.error());
  OpenedImu opened;
  const double rate =
      static_cast<double>(samples->size() - 1) / seconds_between(samples->back().time, samples->front().time);
  opened.notes.push_back(
      {fmt::format("{}: {} samples of an IMU, {:.0f} a second", file->string(), samples->size(), rate),
       false});
  opened.stream = std::make_unique<ImuRecording>(mount, std::move(*samples));
  return opened;
}

}  // namespace cairn
