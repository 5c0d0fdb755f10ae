// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/trails.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "common/base/median.h"
#include "common/image/fit_warp.h"
#include "common/image/patch_border.h"

namespace cairn {
namespace {

/// Keeps the best corner of each cell of a grid first, then the second best, ...: trails all over the
/// image.
std::vector<Candidate> spread(std::vector<Candidate> candidates, const GrayView& image, int cell,
                              size_t count) {
  const int columns = (image.width + cell - 1) / cell;
  const int rows = (image.height + cell - 1) / cell;
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  std::vector<int> taken(static_cast<size_t>(columns * rows), 0);
  std::vector<std::pair<int, size_t>> order;
  order.reserve(candidates.size());
  for (size_t i = 0; i < candidates.size(); ++i) {
    const Corner& c = candidates[i].corner;
    order.emplace_back(taken[static_cast<size_t>(c.y / cell * columns + c.x / cell)]++, i);
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

const Eigen::Vector2f kNowhere = Eigen::Vector2f::Constant(std::numeric_limits<float>::quiet_NaN());

/// Keeps every second.
template <typename T>
void thin_out(std::vector<T>* values) {
  for (size_t i = 1; 2 * i < values->size(); ++i) (*values)[i] = (*values)[2 * i];
  values->resize((values->size() + 1) / 2, values->front());
}

Eigen::Vector2f as_vector(const Corner& c) {
  return {static_cast<float>(c.x), static_cast<float>(c.y)};
}

}  // namespace

TrailFollower::TrailFollower(CameraPtr camera, uint64_t seed, const TrailOptions& options)
    : camera_(std::move(camera)), seed_(seed), options_(options) {}

void TrailFollower::restart() {
  trails_.clear();
  undecided_ = false;
  awaited_.reset();
}

void TrailFollower::begin(const GrayImagePtr& image, Timestamp time, const FrameImages& now) {
  trails_.clear();
  matched_.clear();
  way_.clear();
  view_step_ = options_.view_step;
  first_image_ = image;
  first_time_ = time;
  movement_ = 0;
  tried_at_movement_ = 0;
  const GrayView level0 = now.pyramid.level(0);
  // An image poor in texture gives what it has: the barrier and Shi-Tomasi limit are only for choosing the
  // best.
  auto candidates = find_candidates(level0, now.corners(0), options_.barrier, kPatchBorder, options_.texture);
  if (candidates.size() < static_cast<size_t>(options_.count) / 2) {
    candidates = find_candidates(level0, now.corners(0), options_.low_barrier, kSourcePatchSize / 2 + 1,
                                 options_.low_texture);
  }
  for (const Candidate& c :
       spread(std::move(candidates), level0, options_.cell, static_cast<size_t>(options_.count))) {
    FollowedTrail trail;
    trail.id = TrailId{next_id_++};
    trail.first = trail.now = as_vector(c.corner);
    for (int level = 0; level < kFirstPatches; ++level) {
      FollowedTrail::FirstPatch& first = trail.first_patch[static_cast<size_t>(level)];
      const Eigen::Vector2f at(to_level(trail.first.x(), level), to_level(trail.first.y(), level));
      first.aside = as_vector(rounded(at)) - at;
      first.is_whole = cut_source_patch(now.pyramid.level(level), rounded(at), &first.pixels);
    }
    if (!trail.first_patch[0].is_whole) continue;
    trails_.push_back(trail);
  }
  begun_with_ = trails_.size();
}

void TrailFollower::follow(const GrayImagePtr& image, Timestamp time, const FrameImages& now,
                           const FrameImages& previous, const TinyMotion& motion) {
  if (trails_.empty()) {
    begin(image, time, now);
    note_ = trails_.size() < options_.fewest ? "too few corners in view to start a map"
                                             : "move the camera sideways";
    return;
  }
  matched_.clear();
  std::erase_if(trails_, [&](FollowedTrail& trail) {
    const auto there =
        follow_patch(previous, now, trail.now, moved_by(motion, trail.now, *image), options_.patches);
    if (there) trail.now = *there;
    return !there;
  });
  movement_ = median_movement();
  remember_way(now);
  const auto fewest = std::max<size_t>(
      options_.fewest, static_cast<size_t>(options_.fewest_share * static_cast<float>(begun_with_)));
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
  return reorder_to_median(std::span(movement));
}

Warp TrailFollower::warp_from_first() const {
  std::vector<PixelMatch> ends;
  ends.reserve(trails_.size());
  for (const FollowedTrail& t : trails_) ends.push_back({t.first.cast<double>(), t.now.cast<double>()});
  return fit_warp(ends);
}

/// The level-0 place in `now` where the patch that a trail had in its first frame is found at `level`;
/// nothing where it is not. In a sharp image it is found at level 0, in one that is noisy or blurred perhaps
/// at level 1 only.
std::optional<Eigen::Vector2f> TrailFollower::match_first_patch(const FollowedTrail& trail, int level,
                                                                const Warp& warp,
                                                                const FrameImages& now) const {
  const FollowedTrail::FirstPatch& first = trail.first_patch[static_cast<size_t>(level)];
  PatchTemplate patch;
  if (!first.is_whole || !make_template(first.pixels, warp, 0, &patch)) return std::nullopt;
  const Eigen::Vector2f aside = warp * first.aside;
  const Eigen::Vector2f at(to_level(trail.now.x(), level), to_level(trail.now.y(), level));
  const auto refined = refine_patch(patch, now.pyramid.level(level), at + aside, options_.match_iterations,
                                    options_.most_drift);
  if (!refined) return std::nullopt;
  const Eigen::Vector2f found = *refined - aside;
  return Eigen::Vector2f(from_level(found.x(), level), from_level(found.y(), level));
}

std::span<const Eigen::Vector2f> TrailFollower::match_with_first(const FrameImages& now, size_t most) {
  const size_t count = std::min(most, trails_.size());
  if (matched_.size() < count) {
    const Warp warp = warp_from_first();
    for (const FollowedTrail& t : std::span(trails_).subspan(matched_.size(), count - matched_.size())) {
      std::optional<Eigen::Vector2f> found;
      for (int level = 0; level < kFirstPatches && !found; ++level)
        found = match_first_patch(t, level, warp, now);
      matched_.push_back(found.value_or(kNowhere));
    }
  }
  return std::span(matched_).first(count);
}

/// Keeps positions about every pixel of movement at first, ever fewer of a long way.
void TrailFollower::remember_way(const FrameImages& now) {
  if (movement_ < (way_.empty() ? 0.0F : way_.back()) + view_step_) return;
  if (way_.size() == options_.most_views) {
    view_step_ *= 2;
    thin_out(&way_);
    for (FollowedTrail& t : trails_) thin_out(&t.path);
  }
  way_.push_back(movement_);
  // Trails stay in the order in which they were chosen, all over the image: the first ones will do.
  const auto found = match_with_first(now, options_.most_remembered);
  for (size_t i = 0; i < trails_.size(); ++i)
    trails_[i].path.push_back(i < found.size() ? found[i] : kNowhere);
}

/// The places of trails in views a fifth of the way apart, and now (`last`). Only trails that were found
/// again in all of these are taken, `most_judged` at most.
MultiView TrailFollower::views_on_the_way(std::span<const Eigen::Vector2f> last) const {
  std::vector<size_t> on_the_way;
  auto from = way_.begin();
  for (const float share : {0.2F, 0.4F, 0.6F, 0.8F}) {
    const auto at = std::lower_bound(from, way_.end(), share * movement_);
    if (at == way_.end() || *at >= movement_) break;
    on_the_way.push_back(static_cast<size_t>(at - way_.begin()));
    from = at + 1;
  }
  std::vector<size_t> judged;
  for (size_t i = 0; i < trails_.size(); ++i) {
    const bool everywhere =
        last[i].allFinite() && std::all_of(on_the_way.begin(), on_the_way.end(),
                                           [&](size_t view) { return trails_[i].path[view].allFinite(); });
    if (everywhere) judged.push_back(i);
  }
  const size_t count = std::min<size_t>(judged.size(), options_.most_judged);
  MultiView views;
  for (const size_t view : on_the_way) views.further.push_back({way_[view] / movement_, {}});
  views.further.emplace_back();
  for (size_t k = 0; k < count; ++k) {
    const size_t i = judged[k * judged.size() / count];
    const FollowedTrail& trail = trails_[i];
    views.first.push_back(trail.first.cast<double>());
    for (size_t v = 0; v < on_the_way.size(); ++v)
      views.further[v].pixels.push_back(trail.path[on_the_way[v]].cast<double>());
    views.further.back().pixels.push_back(last[i].cast<double>());
  }
  return views;
}

/// The motion that explains all views best, if noise and the other motions leave no doubt of it.
tl::expected<AdjustedMotion, TwoViewFailure> TrailFollower::choose(const TwoViewMotions& motions,
                                                                   const MultiView& views) const {
  const auto refuse = [](TwoViewRefusal reason, const char* why) {
    return tl::unexpected<TwoViewFailure>({reason, why});
  };
  if (views.further.size() < 2)
    return refuse(TwoViewRefusal::kAmbiguous, "only two views so far: move the camera on");
  if (views.first.size() < options_.fewest_judged)
    return refuse(TwoViewRefusal::kTooFewMatches, "too few trails are seen all the way: move more slowly");
  const MotionsAdjusted adjusted = adjust_motions(*camera_, views, motions.b_from_a);
  const AdjustedMotion* best = clear_best(adjusted);
  // Trails that went astray together, as in blur, can decide for the wrong one: the pair, where it decides by
  // itself, must not be for another of the motions. Its own may move as the views between are heard.
  const bool contradicted = best != nullptr && motions.decided && best != adjusted.motions.data() &&
                            !same_motion(best->last_from_first, motions.b_from_a.front());
  if (best == nullptr || contradicted) {
    return refuse(TwoViewRefusal::kAmbiguous,
                  "two motions explain the matches: move the camera on, in another direction");
  }
  if (!(best->direction_sigma < options_.max_direction_sigma)) {
    return refuse(TwoViewRefusal::kNoParallax,
                  "the direction of the motion is not certain yet: move the camera on");
  }
  return *best;
}

tl::expected<TwoViewGeometry, TwoViewFailure> TrailFollower::judge(const std::vector<PixelMatch>& matches,
                                                                   const MultiView& views) const {
  TwoViewOptions options;
  options.sigma = options_.match_sigma;
  options.seed = seed_;
  const auto motions = find_motions(*camera_, *camera_, matches, options);
  if (!motions) return tl::unexpected(motions.error());
  const auto motion = choose(*motions, views);
  if (!motion) return tl::unexpected(motion.error());
  // Of two views alone nothing says how well the depths are known; all of them together do.
  if (motion->depth_sigma < options_.max_depth_sigma) options.min_median_parallax = kLeastMapParallax;
  return build_two_view(*camera_, *camera_, matches, motion->last_from_first, options);
}

std::optional<SeedProposal> TrailFollower::propose(const GrayImagePtr& image, Timestamp time,
                                                   const FrameImages& now) {
  if (undecided_ || trails_.size() < options_.fewest) return std::nullopt;
  if (movement_ < options_.fewest_movement * static_cast<float>(image->width())) {
    note_ =
        fmt::format("no parallax yet: the image has moved {:.0f} px; move the camera sideways", movement_);
    return std::nullopt;
  }
  if (movement_ < options_.more_movement * tried_at_movement_) return std::nullopt;
  tried_at_movement_ = movement_;

  SeedProposal proposal{first_time_, time, first_image_, image, {}, {}, now.still()};
  std::vector<PixelMatch> matches;
  const auto found = match_with_first(now, trails_.size());
  proposal.trails.reserve(trails_.size());
  matches.reserve(trails_.size());
  for (size_t i = 0; i < trails_.size(); ++i) {
    const FollowedTrail& t = trails_[i];
    const Eigen::Vector2f second = found[i].allFinite() ? found[i] : t.now;
    proposal.trails.push_back({t.id, t.first, second});
    matches.push_back({t.first.cast<double>(), second.cast<double>()});
  }
  const auto geometry = judge(matches, views_on_the_way(found));
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
