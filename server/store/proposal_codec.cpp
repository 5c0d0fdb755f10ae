// SPDX-License-Identifier: Apache-2.0
#include "server/store/proposal_codec.h"

#include <cmath>

#include "common/base/utf8.h"
#include "common/image/pyramid.h"
#include "common/image/still_mask.h"
#include "common/map/limits.h"
#include "server/store/bytes.h"

namespace cairn {
namespace {

constexpr size_t kMeasurementBytes = sizeof(uint64_t) + 1 + 2 * sizeof(float);
constexpr size_t kCandidateBytes = kMeasurementBytes + 2 * sizeof(float);

template <typename Seen>
void put_seen(const Seen& seen, ByteWriter* out) {
  out->put(seen.id.value);
  out->put(seen.level);
  out->put(seen.pixel);
}

/// Whether it can have been seen in an image.
template <typename Seen>
bool get_seen(ByteReader* in, Seen* seen) {
  seen->id.value = in->get<uint64_t>();
  seen->level = in->get<uint8_t>();
  seen->pixel = in->get_vector<Eigen::Vector2f>();
  return seen->level < kPyramidLevels && seen->pixel.allFinite();
}

void put_summary(const ProposalSummary& summary, ByteWriter* out) {
  out->put_text(summary.client);
  out->put(summary.session.value);
  out->put(summary.seq);
  out->put_text(summary.why);
  out->put(summary.received.nanoseconds);
  out->put(summary.time.nanoseconds);
  out->put(summary.epoch.value);
  put_pose(summary.camera_from_map, out);
  out->put(summary.mean_depth);
  out->put(summary.expected);
  out->put(summary.found);
  out->put(summary.bytes);
}

bool get_summary(ByteReader* in, ProposalSummary* summary) {
  summary->client = in->get_text();
  summary->session.value = in->get<uint64_t>();
  summary->seq = in->get<uint64_t>();
  summary->why = one_line(in->get_text());
  summary->received.nanoseconds = in->get<int64_t>();
  summary->time.nanoseconds = in->get<int64_t>();
  summary->epoch.value = in->get<uint64_t>();
  const auto pose = get_pose(in);
  summary->mean_depth = in->get<double>();
  summary->expected = in->get<uint32_t>();
  summary->found = in->get<uint32_t>();
  summary->bytes = in->get<uint64_t>();
  const bool is_sound = pose && is_valid_name(summary->client) && is_time(summary->received) &&
                        is_time(summary->time) && summary->found <= summary->expected &&
                        std::abs(summary->mean_depth) <= kMaxLength;  // false for NaN
  if (is_sound) summary->camera_from_map = *pose;
  return is_sound;
}

bool get_camera(ByteReader* in, CameraParameters* camera) {
  std::vector<uint8_t> row(in->get_count(1));
  in->get(row);
  auto decoded = decode_camera(row);
  if (!decoded || !make_camera(*decoded)) return false;
  *camera = std::move(*decoded);
  return true;
}

bool get_measurements(ByteReader* in, std::vector<PointMeasurement>* measurements) {
  measurements->resize(in->get_count(kMeasurementBytes));
  if (measurements->size() > kMaxMeasurements) return false;
  for (PointMeasurement& m : *measurements)
    if (!get_seen(in, &m)) return false;
  return true;
}

bool get_candidates(ByteReader* in, std::vector<PointCandidate>* candidates) {
  candidates->resize(in->get_count(kCandidateBytes));
  if (candidates->size() > kMaxCandidates) return false;
  for (PointCandidate& c : *candidates) {
    if (!get_seen(in, &c)) return false;
    c.inverse_depth = in->get<float>();
    c.sigma = in->get<float>();
    const bool has_depth = c.inverse_depth > 0 && c.sigma > 0;  // false for NaN
    if (!has_depth || !std::isfinite(c.inverse_depth) || !std::isfinite(c.sigma)) return false;
  }
  return true;
}

bool get_up(ByteReader* in, std::optional<UpDirection>* up) {
  const auto known = in->get<uint8_t>();
  if (known == 0) return true;
  *up = UpDirection{in->get_vector<Eigen::Vector3d>(), in->get<double>()};
  return known == 1 && std::abs((*up)->up.norm() - 1) <= kUnitTolerance && (*up)->sigma > 0 &&
         std::isfinite((*up)->sigma);
}

}  // namespace

Blob encode_proposal(const ProposalRecord& proposal) {
  ByteWriter out;
  put_summary(proposal.summary, &out);
  out.put(proposal.reference.value);
  put_pose(proposal.camera_from_reference, &out);
  const Blob camera = encode_camera(proposal.camera);
  out.put(static_cast<uint32_t>(camera.size()));
  out.put(std::span(camera));
  out.put(static_cast<uint32_t>(proposal.measurements.size()));
  for (const PointMeasurement& m : proposal.measurements) put_seen(m, &out);
  out.put(static_cast<uint32_t>(proposal.candidates.size()));
  for (const PointCandidate& c : proposal.candidates) {
    put_seen(c, &out);
    out.put(c.inverse_depth);
    out.put(c.sigma);
  }
  out.put(static_cast<uint8_t>(proposal.up ? 1 : 0));
  if (proposal.up) {
    out.put(proposal.up->up);
    out.put(proposal.up->sigma);
  }
  out.put(std::span(proposal.still_mask));
  return out.take();
}

std::optional<ProposalRecord> decode_proposal(int64_t id, std::span<const uint8_t> row) {
  ByteReader in(row);
  ProposalRecord proposal;
  if (id < 1 || !get_summary(&in, &proposal.summary)) return std::nullopt;
  proposal.summary.number = static_cast<uint64_t>(id);
  proposal.reference.value = in.get<uint64_t>();
  const auto pose = get_pose(&in);
  if (!pose || !get_camera(&in, &proposal.camera)) return std::nullopt;
  proposal.camera_from_reference = *pose;
  if (!get_measurements(&in, &proposal.measurements) || !get_candidates(&in, &proposal.candidates) ||
      !get_up(&in, &proposal.up))
    return std::nullopt;
  proposal.still_mask.resize(in.left());
  in.get(proposal.still_mask);
  const bool has_sound_mask =
      proposal.still_mask.empty() ||
      still_mask_of(proposal.camera.width, proposal.camera.height, proposal.still_mask) != nullptr;
  if (!in.finished() || !has_sound_mask) return std::nullopt;
  return proposal;
}

}  // namespace cairn
