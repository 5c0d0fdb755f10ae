// SPDX-License-Identifier: Apache-2.0
#include "tests/world/annotation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <optional>

#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::string_view kPlacesFile = "places.txt";
constexpr std::string_view kPhasesFile = "phases.txt";
constexpr std::string_view kNothing = "-";

Result<std::ofstream> open_file(const std::filesystem::path& path) {
  std::ofstream file(path);
  if (!file) return fail(ErrorCode::kIo, path.string() + ": cannot be written");
  file << std::fixed << std::setprecision(9);
  return file;
}

Status write_places(const std::filesystem::path& path, const Annotation& annotation) {
  auto file = open_file(path);
  if (!file) return tl::unexpected(file.error());
  *file
      << "# timestamp place share tx ty tz qx qy qz qw: a place that the frame shows, its share of the "
         "image,\n"
         "# and its pose (place to the world of groundtruth.txt); `timestamp -`: the frame shows no place\n";
  for (const Annotation::Frame& frame : annotation.frames) {
    if (frame.shares.empty()) *file << format_timestamp(frame.time) << ' ' << kNothing << '\n';
    for (const auto& [place, share, pose] : frame.shares) {
      const Eigen::Vector3d& t = pose.translation();
      const Eigen::Quaterniond& q = pose.rotation();
      *file << format_timestamp(frame.time) << ' ' << annotation.places[static_cast<size_t>(place)] << ' '
            << std::setprecision(4) << share << std::setprecision(9) << ' ' << t.x() << ' ' << t.y() << ' '
            << t.z() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' ' << q.w() << '\n';
    }
  }
  if (!file->flush()) return fail(ErrorCode::kIo, path.string() + ": write failed (disk full?)");
  return {};
}

Status write_phases(const std::filesystem::path& path, const Annotation& annotation) {
  auto file = open_file(path);
  if (!file) return tl::unexpected(file.error());
  *file << "# begin end kind place: times of the first frame and of the one after the last; kind is\n"
           "# map (make a map of the place), walk (to the place) or visit\n";
  for (const auto& [kind, place, begin, end] : annotation.phases) {
    *file << format_timestamp(begin) << ' ' << format_timestamp(end) << ' ' << to_string(kind) << ' '
          << annotation.places[static_cast<size_t>(place)] << '\n';
  }
  if (!file->flush()) return fail(ErrorCode::kIo, path.string() + ": write failed (disk full?)");
  return {};
}

/// Index of a name, added if new.
int place_index(std::string_view name, std::vector<std::string>* places) {
  const auto found = std::ranges::find(*places, name);
  if (found != places->end()) return static_cast<int>(found - places->begin());
  places->emplace_back(name);
  return static_cast<int>(places->size()) - 1;
}

std::optional<Annotation::Share> parse_share(const std::vector<std::string_view>& fields,
                                             std::vector<std::string>* places) {
  std::array<double, 8> v{};
  for (size_t i = 0; i < v.size(); ++i) {
    const auto number = parse_number(fields[i + 2]);
    if (!number) return std::nullopt;
    v[i] = *number;
  }
  const Eigen::Quaterniond rotation(v[7], v[4], v[5], v[6]);
  if (std::abs(rotation.norm() - 1) > 1e-3) return std::nullopt;
  return Annotation::Share{place_index(fields[1], places), v[0], SE3(rotation, {v[1], v[2], v[3]})};
}

Status read_places(const std::filesystem::path& path, Annotation* annotation) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  for (const TextLine& line : data_lines(*content)) {
    const auto fields = split_fields(line.text);
    const bool nothing = fields.size() == 2 && fields[1] == kNothing;
    const auto time = parse_timestamp(fields[0]);
    std::optional<Annotation::Share> share;
    if (fields.size() == 10) share = parse_share(fields, &annotation->places);
    if (!time || (!nothing && !share)) {
      return fail(ErrorCode::kDamaged, at_line(path, line.number, "expected a time and `-`, or ten fields"));
    }
    std::vector<Annotation::Frame>& frames = annotation->frames;
    if (frames.empty() || frames.back().time != *time) frames.push_back({*time, {}});
    if (share) frames.back().shares.push_back(*share);
  }
  return {};
}

Status read_phases(const std::filesystem::path& path, Annotation* annotation) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  for (const TextLine& line : data_lines(*content)) {
    const auto fields = split_fields(line.text);
    std::optional<PhaseKind> kind;
    for (const PhaseKind known : {PhaseKind::kMap, PhaseKind::kWalk, PhaseKind::kVisit}) {
      if (fields.size() == 4 && fields[2] == to_string(known)) kind = known;
    }
    const auto begin = kind ? parse_timestamp(fields[0]) : std::nullopt;
    const auto end = kind ? parse_timestamp(fields[1]) : std::nullopt;
    if (!begin || !end) {
      return fail(ErrorCode::kDamaged,
                  at_line(path, line.number, "expected `begin end map|walk|visit place`"));
    }
    annotation->phases.push_back({*kind, place_index(fields[3], &annotation->places), *begin, *end});
  }
  return {};
}

}  // namespace

bool Annotation::mapped(int place) const {
  return std::ranges::any_of(phases, [place](const TimedPhase& phase) {
    return phase.kind == PhaseKind::kMap && phase.place == place;
  });
}

Annotation annotate(const Simulator& simulator) {
  Annotation annotation;
  for (const Place& place : simulator.places()) annotation.places.push_back(place.name);
  for (int i = 0; i < simulator.frame_count(); ++i) {
    annotation.frames.push_back({simulator.time(i), {}});
    for (const auto& [place, share, pose] : simulator.view(i).places) {
      if (share >= kLeastShare) annotation.frames.back().shares.push_back({place, share, pose});
    }
  }
  // A phase's own frames decide its times; one that comes after the last frame is not there.
  const auto shown = [&](const Phase& phase) {
    const auto first = std::ranges::lower_bound(annotation.frames, Timestamp::from_seconds(phase.begin), {},
                                                &Annotation::Frame::time);
    const auto last = std::ranges::lower_bound(
        first, annotation.frames.end(), Timestamp::from_seconds(phase.end), {}, &Annotation::Frame::time);
    return std::pair(first, last);
  };
  for (const Phase& phase : simulator.phases()) {
    const auto [first, last] = shown(phase);
    if (first == last) continue;
    const Timestamp end = std::prev(last)->time + std::chrono::nanoseconds(std::chrono::seconds(1)) /
                                                      static_cast<int>(kSimulatorFrameRate);
    annotation.phases.push_back({phase.kind, phase.place, first->time, end});
  }
  return annotation;
}

Status write_annotation(const std::filesystem::path& directory, const Annotation& annotation) {
  if (auto status = write_places(directory / kPlacesFile, annotation); !status) return status;
  return write_phases(directory / kPhasesFile, annotation);
}

Result<Annotation> read_annotation(const std::filesystem::path& directory) {
  Annotation annotation;
  // Phases first: they name every place in the order in which it is first gone to.
  if (auto status = read_phases(directory / kPhasesFile, &annotation); !status) {
    return tl::unexpected(status.error());
  }
  if (auto status = read_places(directory / kPlacesFile, &annotation); !status) {
    return tl::unexpected(status.error());
  }
  return annotation;
}

}  // namespace cairn
