// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/trails.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

#include "common/geometry/two_view.h"

namespace cairn {
namespace {

constexpr float kSearchRadius = 10;  // PTAM r114 [px]
constexpr float kMarriedDistance =
    1.0F;                             // [px] backward match to the start (PTAM: sqrt 2, without sub-pixel)
constexpr size_t kFewestTrails = 60;  // fewer are not worth following
constexpr float kFewestShare = 0.2F;  // of those begun: below, what is left covers too little of the view
constexpr float kFewestMovement =
    0.012F;                             // of the image width: median movement before the first two-view test
constexpr float kMoreMovement = 1.15F;  // factor of movement between two-view tests
constexpr float kWayStep = 1.0F;        // [px] of median movement between remembered positions
constexpr size_t kMostWay = 64;
constexpr float kMatchSigma = 0.7F;  // [px] of a sub-pixel trail
constexpr float kMostDrift = 2.0F;   // [px] what matching with the first patch may correct

/// Keeps the best corner of each cell of a grid first, then the second best, ...: trails all over the
/// picture.
std::vector<Candidate> spread(std::vector<Candidate> candidates, const GrayView& image, size_t count) {
  constexpr int kCell = 32;  // [px]
  const int columns = (image.width + kCell - 1) / kCell;
  const int rows = (image.height + kCell - 1) / kCell;
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  std::vector<int> taken(static_cast<size_t>(columns * rows), 0);
  std::vector<std::pair<int, size_t>> order;
  order.reserve(candidates.size());
  for (size_t i = 0; i < candidates.size(); ++i) {
    const Corner& c = candidates[i].corner;
    order.emplace_back(taken[static_cast<size_t>(c.y / kCell * columns + c.x / kCell)]++, i);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  order.resize(std::min(order.size(), count));
  std::vector<Candidate> chosen;
  chosen.reserve(order.size());
  for (const auto& [round, index] : order) chosen.push_back(candidates[index]);
  return chosen;
}

Corner rounded(const Eigen::Vector2f& p) {
  return {static_cast<int16_t>(std::lround(p.x())), static_cast<int16_t>(std::lround(p.y()))};
}

Eigen::Vector2f as_vector(const Corner& c) {
  return {static_cast<float>(c.x), static_cast<float>(c.y)};
}

}  // namespace

TrailFollower::TrailFollower(CameraPtr camera, const TrackerOptions& options)
    : camera_(std::move(camera)), options_(options) {}

void TrailFollower::restart() {
  trails_.clear();
  undecided_ = false;
}

void TrailFollower::begin(const GrayImagePtr& image, Timestamp time, const FrameImages& now) {
  trails_.clear();
  way_.clear();
  first_image_ = image;
  first_time_ = time;
  movement_ = 0;
  tried_at_movement_ = 0;
  const GrayView level0 = now.pyramid.level(0);
  // A picture poor in texture gives what it has: the barrier and Shi-Tomasi limit are only for choosing the
  // best.
  auto candidates = find_candidates(level0, now.corners(0));
  if (candidates.size() < static_cast<size_t>(options_.trail_count) / 2) {
    constexpr int kLowBarrier = 6;
    constexpr float kLowShiTomasi = 20.0F;
    candidates =
        find_candidates(level0, now.corners(0), kLowBarrier, kSourcePatchSize / 2 + 1, kLowShiTomasi);
  }
  for (const Candidate& c :
       spread(std::move(candidates), level0, static_cast<size_t>(options_.trail_count))) {
    FollowedTrail trail;
    if (!cut_source_patch(level0, c.corner, &trail.first_patch)) continue;
    trail.id = TrailId{next_id_++};
    trail.first = trail.now = as_vector(c.corner);
    trails_.push_back(trail);
  }
  begun_with_ = trails_.size();
}

bool TrailFollower::follow_one(const FrameImages& now, const FrameImages& previous,
                               const Eigen::Vector2f& expected, FollowedTrail* trail) const {
  constexpr int kRefinements = 8;
  const GrayView before = previous.pyramid.level(0);
  const GrayView image = now.pyramid.level(0);
  const Corner from = rounded(trail->now);
  SourcePatch cut;
  PatchTemplate patch;
  if (!cut_source_patch(before, from, &cut) || !make_template(cut, Warp::Identity(), 0, &patch)) return false;
  // Straight from where the tiny images say it went; a corner in a noisy picture comes and goes, the texture
  // stays.
  auto there = refine_patch(patch, image, expected + (as_vector(from) - trail->now), kRefinements);
  if (!there) {
    const auto match = find_patch(patch, image, now.corners(0), expected, kSearchRadius);
    if (!match) return false;
    there = refine_patch(patch, image, as_vector(match->corner), kRefinements);
    if (!there) return false;
  }

  const Corner to = rounded(*there);
  PatchTemplate back;
  if (!cut_source_patch(image, to, &cut) || !make_template(cut, Warp::Identity(), 0, &back)) return false;
  const auto home = refine_patch(back, before, as_vector(from) + (as_vector(to) - *there), kRefinements);
  if (!home) return false;
  const Eigen::Vector2f returned = *home + (*there - as_vector(to));
  if ((returned - as_vector(from)).norm() > kMarriedDistance) return false;
  trail->now = *there + (trail->now - as_vector(from));
  return true;
}

void TrailFollower::follow(const GrayImagePtr& image, Timestamp time, const FrameImages& now,
                           const FrameImages& previous, const TinyMotion& motion) {
  if (trails_.empty()) {
    begin(image, time, now);
    note_ = trails_.size() < kFewestTrails ? "too few corners in view to start a map"
                                           : "move the camera sideways";
    return;
  }
  const float scale = static_cast<float>(1 << kPyramidLevels);
  const Eigen::Vector2f center((static_cast<float>(image->width()) - 1) / 2,
                               (static_cast<float>(image->height()) - 1) / 2);
  const Eigen::Matrix2f turn = Eigen::Rotation2Df(motion.angle).toRotationMatrix();
  std::erase_if(trails_, [&](FollowedTrail& trail) {
    const Eigen::Vector2f expected = center + turn * (trail.now - center) + scale * motion.shift;
    return !follow_one(now, previous, expected, &trail);
  });
  movement_ = median_movement();
  remember_way();
  const auto fewest =
      std::max(kFewestTrails, static_cast<size_t>(kFewestShare * static_cast<float>(begun_with_)));
  if (trails_.size() < fewest && !undecided_) {
    begin(image, time, now);
    note_ = "trails were lost; began again: move the camera sideways, slowly";
  }
}

float TrailFollower::median_movement() const {
  if (trails_.empty()) return 0;
  std::vector<float> movement;
  movement.reserve(trails_.size());
  for (const FollowedTrail& t : trails_) movement.push_back((t.now - t.first).norm());
  const auto middle = movement.begin() + static_cast<ptrdiff_t>(movement.size() / 2);
  std::nth_element(movement.begin(), middle, movement.end());
  return *middle;
}

Eigen::Vector2f TrailFollower::match_with_first(const FollowedTrail& trail, const FrameImages& now) const {
  constexpr int kRefinements = 10;
  PatchTemplate patch;
  if (!make_template(trail.first_patch, Warp::Identity(), 0, &patch)) return trail.now;
  const auto refined = refine_patch(patch, now.pyramid.level(0), trail.now, kRefinements, kMostDrift);
  return refined.value_or(trail.now);
}

/// Keeps positions about every pixel of movement, so that any number of frames leaves some tens.
void TrailFollower::remember_way() {
  if (movement_ < (way_.empty() ? 0.0F : way_.back()) + kWayStep) return;
  if (way_.size() == kMostWay) return;
  way_.push_back(movement_);
  for (FollowedTrail& t : trails_) t.path.push_back(t.now);
}

/// Trails drift from frame to frame; matching the second view with the first tells how much, and the drift
/// grew on the way.
std::vector<ThirdView> TrailFollower::views_between(const SeedProposal& proposal) const {
  std::vector<ThirdView> views;
  for (const float share : {0.25F, 0.5F, 0.75F}) {
    const auto at = std::lower_bound(way_.begin(), way_.end(), share * movement_);
    if (at == way_.end() || *at >= movement_) continue;
    const float way = *at / movement_;
    const auto index = static_cast<size_t>(at - way_.begin());
    ThirdView view{way, {}};
    for (size_t i = 0; i < trails_.size(); ++i) {
      const Eigen::Vector2f drift = proposal.trails[i].second - trails_[i].now;
      view.pixels.push_back((trails_[i].path[index] + way * drift).cast<double>());
    }
    views.push_back(std::move(view));
  }
  return views;
}

tl::expected<TwoViewGeometry, TwoViewFailure> TrailFollower::judge(const std::vector<PixelMatch>& matches,
                                                                   const SeedProposal& proposal) const {
  TwoViewOptions options;
  options.sigma = kMatchSigma;
  options.seed = options_.seed;
  const auto motions = find_motions(*camera_, *camera_, matches, options);
  if (!motions) return tl::unexpected(motions.error());
  size_t best = 0;
  if (motions->b_from_a.size() > 1) {
    const auto choice =
        choose_motion(*camera_, matches, motions->b_from_a, views_between(proposal), kMatchSigma);
    // Trails that went astray together, as in blur, can decide for the wrong one: no witness may contradict.
    const bool contradicted = motions->decided && choice.decided && choice.best != 0;
    if (contradicted || (!motions->decided && !choice.decided)) {
      return tl::unexpected<TwoViewFailure>(
          {TwoViewRefusal::kAmbiguous,
           "two motions explain the matches: move the camera on, in another direction"});
    }
    if (!motions->decided) best = choice.best;
  }
  return build_two_view(*camera_, *camera_, matches, motions->model, motions->b_from_a[best], options);
}

std::optional<SeedProposal> TrailFollower::propose(const GrayImagePtr& image, Timestamp time,
                                                   const FrameImages& now) {
  if (undecided_ || trails_.size() < kFewestTrails) return std::nullopt;
  if (movement_ < kFewestMovement * static_cast<float>(image->width())) {
    note_ =
        fmt::format("no parallax yet: the picture has moved {:.0f} px; move the camera sideways", movement_);
    return std::nullopt;
  }
  if (movement_ < kMoreMovement * tried_at_movement_) return std::nullopt;
  tried_at_movement_ = movement_;

  SeedProposal proposal{first_time_, time, first_image_, image, {}, {}};
  std::vector<PixelMatch> matches;
  proposal.trails.reserve(trails_.size());
  matches.reserve(trails_.size());
  for (const FollowedTrail& t : trails_) {
    const Eigen::Vector2f second = match_with_first(t, now);
    proposal.trails.push_back({t.id, t.first, second});
    matches.push_back({t.first.cast<double>(), second.cast<double>()});
  }
  const auto geometry = judge(matches, proposal);
  if (!geometry) {
    note_ = geometry.error().message;
    return std::nullopt;
  }
  note_ = fmt::format("proposed a map: {} trails, parallax {:.1f} degrees", geometry->inliers,
                      geometry->median_parallax * 180 / M_PI);
  proposal.second_from_first = geometry->b_from_a;
  undecided_ = true;
  return proposal;
}

void TrailFollower::refused(const std::string& reason) {
  undecided_ = false;
  note_ = "refused by the server: " + reason;
}

std::vector<TrailFollower::Live> TrailFollower::live() const {
  std::vector<Live> out;
  out.reserve(trails_.size());
  for (const FollowedTrail& t : trails_) out.push_back({t.id, t.now});
  return out;
}

void TrailFollower::lines(std::vector<TrailLine>* out) const {
  out->clear();
  for (const FollowedTrail& t : trails_) out->push_back({t.first, t.now});
}

}  // namespace cairn
