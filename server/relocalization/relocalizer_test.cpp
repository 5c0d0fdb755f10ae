// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/relocalizer.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "server/relocalization/overlap_detector.h"
#include "server/relocalization/places_fixture.h"
#include "server/relocalization/votes.h"

namespace cairn {
namespace {

using testing::all_maps;
using testing::camera_of;
using testing::describe_image;
using testing::error_of;
using testing::ExactMap;
using testing::Scene;

constexpr double kNever = 1.01;  ///< more than anything can be alike

class RelocalizerTest : public testing::PlacesTest {
 protected:
  [[nodiscard]] Confirmation ask_second_keyframe(const PlaceView& view, const ConfirmOptions& options) const {
    const auto cells = probed_cells(view);
    const IndexedMap& indexed = *index_.find(map().snapshot()->map);
    return confirm(view, cells, CornerGrid(view, *scene().camera()), *scene().camera(), indexed, 1,
                   run_prefilter(view, cells, indexed, 1, MatchOptions()), options);
  }
};

TEST_F(RelocalizerTest, AViewOfAMappedPlaceIsFoundInItsMapWithItsPose) {
  for (const int step : {1, 2, 5, 7, 9}) {
    SCOPED_TRACE(step);
    for (const auto& [scene, map] :
         {std::pair(&places_->scene, &places_->map), std::pair(&places_->other_scene, &places_->other_map)}) {
      const auto image = scene->render(Scene::pose(step), 100 + static_cast<uint64_t>(step));
      const RelocalizationAnswer answer =
          relocalize(index_, *scene->camera(), describe_image(image->view()), RelocOptions());
      ASSERT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << answer.reason;
      EXPECT_EQ(answer.candidates.front().map, map->snapshot()->map);
      EXPECT_EQ(answer.candidates.front().epoch, Epoch{3});
      EXPECT_LT(error_of(camera_of(answer, *map->snapshot()), Scene::pose(step), *map->snapshot()), 0.01);
    }
  }
}

TEST_F(RelocalizerTest, AnUnmappedPlaceIsNotKnown) {
  const Scene elsewhere(13);
  for (const int step : {0, 3, 8}) {
    const auto image = elsewhere.render(Scene::pose(step), 1);
    const RelocalizationAnswer answer =
        relocalize(index_, *elsewhere.camera(), describe_image(image->view()), RelocOptions());
    EXPECT_EQ(answer.verdict, RelocalizationVerdict::kNotKnown) << step;
    EXPECT_FALSE(answer.reason.empty());
    for (const PlaceCandidate& c : answer.candidates) EXPECT_FALSE(c.reason.empty());
  }
}

TEST_F(RelocalizerTest, AnImageIsFoundInEachMapThatHasItsPlace) {
  const ExactMap again(scene(), 3, {1, 5});
  index_.put(again.index());
  const auto image = scene().render(Scene::pose(4), 104);
  const auto found = find_in_each_map(index_, *scene().camera(), describe_image(image->view()), {});
  ASSERT_EQ(found.size(), 2U);
  EXPECT_NE(found[0].map, found[1].map);
  for (const PlaceCandidate& place : found) {
    const MapSnapshot& there = place.map == map().snapshot()->map ? *map().snapshot() : *again.snapshot();
    EXPECT_EQ(place.map, there.map);
    const SE3 camera = place.camera_from_keyframe * there.find(place.keyframe)->camera_from_map;
    EXPECT_LT(error_of(camera, Scene::pose(4), there), 0.01);
  }
  const Scene elsewhere(13);
  const auto strange = elsewhere.render(Scene::pose(4), 1);
  EXPECT_TRUE(find_in_each_map(index_, *elsewhere.camera(), describe_image(strange->view()), {}).empty());
}

TEST(Acceptance, WhatMovedTogetherButNoPoseBringsTogetherSpeaksAgainstThePlace) {
  Confirmation said;
  said.similarity = 0.6;
  said.order = 0.8;
  said.supported = 40;
  said.agreeing = 38;
  EXPECT_NEAR(unity(said), 0.95, 1e-9);
  EXPECT_GT(evidence(said), ConfirmOptions{}.by_image.evidence);
  said.agreeing = 14;
  EXPECT_LT(evidence(said), ConfirmOptions{}.by_image.evidence);
  said.found_otherwise = 24;
  EXPECT_NEAR(unity(said), 0.95, 1e-9) << "keys taken for their neighbours";
  said.supported = 10;
  EXPECT_EQ(unity(said), 1) << "what no neighbour supports may agree, too";
}

/// Points of one part of a keyframe that lie aside of where they are, as those of keys do that were taken for
/// their neighbours: the other keyframes know what is at their corners.
TEST_F(RelocalizerTest, CornersThatThePoseExplainsOtherwiseAreNotHeldAgainstIt) {
  constexpr size_t kKeyframe = 1;
  const auto image = scene().render(Scene::pose(5), 105);
  const PlaceView view = describe_image(image->view());
  const auto ask = [&](const IndexedMap& map) {
    const auto cells = probed_cells(view);
    return confirm(view, cells, CornerGrid(view, *scene().camera()), *scene().camera(), map, kKeyframe,
                   run_prefilter(view, cells, map, kKeyframe, MatchOptions()), {});
  };
  const IndexedMapPtr exact = map().index();
  const Confirmation plain = ask(*exact);
  ASSERT_TRUE(plain.confirmed) << plain.reason;
  EXPECT_LE(plain.found_otherwise, plain.supported / 10);

  IndexedMap moved(*exact);
  const IndexedKeyframe& keyframe = *moved.keyframes[kKeyframe];
  const float third = static_cast<float>(scene().camera()->width()) / 3;
  for (size_t i = 0; i < keyframe.measured.size(); ++i) {
    if (keyframe.sightings[i].pixel.x() < third) moved.positions[kKeyframe][i].x() += 0.1F;
  }
  const Confirmation said = ask(moved);
  ASSERT_TRUE(said.confirmed) << said.reason;
  EXPECT_LT(said.agreeing, 0.9 * said.supported);
  EXPECT_GT(said.found_otherwise, (said.supported - said.agreeing) / 2);
  EXPECT_LE(said.agreeing + said.found_otherwise, said.matches) << "none is counted twice";
  EXPECT_GT(unity(said), 0.9);
}

/// Of the left `share` of an image what was above is below: things that were moved.
GrayImage rearranged(const GrayView& image, double share) {
  GrayImage changed(image);
  const auto width = static_cast<size_t>(share * image.width);
  for (int y = 0; y < image.height; ++y)
    std::copy_n(image.row((y + image.height / 2) % image.height), width, changed.row(y));
  return changed;
}

TEST_F(RelocalizerTest, APlaceOfWhichAPartHasMovedIsFoundByWhatStandsAllAboutIt) {
  RelocOptions without;
  without.confirm.by_extent.similarity = kNever;
  for (const int step : {5, 6, 7}) {
    SCOPED_TRACE(step);
    const auto image = scene().render(Scene::pose(step), 400 + static_cast<uint64_t>(step));
    const auto ask = [&](double share, const RelocOptions& options) {
      return relocalize(index_, *scene().camera(), describe_image(rearranged(image->view(), share)), options);
    };
    EXPECT_EQ(ask(0.4, without).verdict, RelocalizationVerdict::kNotKnown) << "nothing else speaks for it";
    const RelocalizationAnswer answer = ask(0.4, {});
    ASSERT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << answer.reason;
    EXPECT_LT(error_of(camera_of(answer, *map().snapshot()), Scene::pose(step), *map().snapshot()), 0.01);
    EXPECT_EQ(ask(0.45, {}).verdict, RelocalizationVerdict::kNotKnown) << "what stands lies in one half";
  }
}

/// As if more corners had to agree than do.
RelocOptions few_agree() {
  RelocOptions options;
  options.confirm.enough_agreeing = 1000;
  return options;
}

/// Cells of an image show what those on the other side of it show.
GrayImage with_inconsistent_cells(const GrayView& image, const std::vector<size_t>& cells) {
  const auto width = static_cast<size_t>(image.width) / kCellsAcross;
  const auto height = static_cast<size_t>(image.height) / kCellsDown;
  GrayImage changed(image);
  for (const size_t cell : cells) {
    const size_t other = (cell + kImageCells / 2) % kImageCells;
    for (size_t y = 0; y < height; ++y)
      std::copy_n(
          image.row(static_cast<int>(other / kCellsAcross * height + y)) + other % kCellsAcross * width,
          width,
          changed.row(static_cast<int>(cell / kCellsAcross * height + y)) + cell % kCellsAcross * width);
  }
  return changed;
}

/// A place like this one is like it in part: the same things stand there, and others. The corners here agree,
/// and the image is alike in the mean.
TEST_F(RelocalizerTest, WhereTwoCellsShowSomethingElseSimilarityInTheMeanIsNotEnough) {
  ConfirmOptions by_image;
  by_image.by_points.evidence = kNever;
  by_image.by_extent.similarity = kNever;
  ConfirmOptions in_the_mean = by_image;
  in_the_mean.by_image.inconsistent_cells = kImageCells;
  ConfirmOptions few = few_agree().confirm;
  few.by_few.evidence = by_image.by_image.evidence;
  ConfirmOptions few_in_the_mean = few;
  few_in_the_mean.by_few.inconsistent_cells = kImageCells;
  const IndexedMapPtr indexed = map().index();
  int one = 0;
  int more = 0;
  for (const int step : {3, 4, 5}) {
    SCOPED_TRACE(step);
    const auto image = scene().render(Scene::pose(step), 600 + static_cast<uint64_t>(step));
    PlaceView view = describe_image(image->view());
    const GrayImage small(view.small.view());
    const auto cells = probed_cells(view);
    const CornerGrid grid(view, *scene().camera());
    const auto ask = [&](const ConfirmOptions& options) {
      return confirm(view, cells, grid, *scene().camera(), *indexed, 1,
                     run_prefilter(view, cells, *indexed, 1, MatchOptions()), options);
    };
    EXPECT_EQ(ask(by_image).inconsistent_cells, 0);
    for (size_t cell = 0; cell < kImageCells; ++cell) {
      view.small = with_inconsistent_cells(small.view(), {cell});
      EXPECT_LE(ask(by_image).inconsistent_cells, 1) << "cell " << cell;
      EXPECT_TRUE(ask(by_image).confirmed) << "one thing may have moved: cell " << cell;
      one += ask(by_image).inconsistent_cells;
      view.small =
          with_inconsistent_cells(small.view(), {cell, (cell + 1) % kImageCells, (cell + 2) % kImageCells});
      if (!ask(in_the_mean).confirmed || !ask(few_in_the_mean).confirmed) continue;
      const bool is_like = ask(by_image).inconsistent_cells <= 1;
      EXPECT_EQ(ask(by_image).confirmed, is_like);
      EXPECT_EQ(ask(few).confirmed, is_like);
      more += is_like ? 0 : 1;
    }
  }
  EXPECT_GE(one, 12) << "of 36";
  EXPECT_GE(more, 12) << "of 36";
}

TEST_F(RelocalizerTest, WhereFewCornersAgreeTheImageMustSpeakClearly) {
  constexpr double kMoved = 0.28;
  for (const int step : {5, 6, 7}) {
    SCOPED_TRACE(step);
    const auto image = scene().render(Scene::pose(step), 500 + static_cast<uint64_t>(step));
    const PlaceView same = describe_image(image->view());
    PlaceView partly = describe_image(image->view());
    partly.small = rearranged(same.small.view(), kMoved);
    const auto ask = [&](const PlaceView& view, const RelocOptions& options) {
      return relocalize(index_, *scene().camera(), view, options).verdict;
    };
    EXPECT_EQ(ask(same, few_agree()), RelocalizationVerdict::kConfirmed);
    EXPECT_EQ(ask(partly, {}), RelocalizationVerdict::kConfirmed) << "enough agree";
    EXPECT_EQ(ask(partly, few_agree()), RelocalizationVerdict::kNotKnown);
  }
}

TEST_F(RelocalizerTest, TheFewerCornersAgreeTheMoreEvidenceIsAsked) {
  const PlaceView view = describe_image(scene().render(Scene::pose(5), 105)->view());
  ConfirmOptions options;
  options.by_points.evidence = options.by_extent.similarity = kNever;
  const Confirmation clear = ask_second_keyframe(view, options);
  ASSERT_TRUE(clear.confirmed) << clear.reason;
  options.by_image.evidence = evidence(clear) - 0.01;
  options.by_few.evidence = evidence(clear) + 0.01;
  options.enough_agreeing = clear.agreeing;
  const auto is_confirmed_of = [&](int many) {
    options.many_agreeing = many;
    return ask_second_keyframe(view, options).confirmed;
  };
  EXPECT_TRUE(is_confirmed_of(clear.agreeing)) << "many agree";
  EXPECT_FALSE(is_confirmed_of(clear.agreeing + 4)) << "hardly enough: 0.8 of the way to what few need";
  options.enough_agreeing = clear.agreeing - 5;
  EXPECT_TRUE(is_confirmed_of(clear.agreeing + 3)) << "a third of the way";
}

TEST_F(RelocalizerTest, APoseWithWhichFewCornersAgreeExplainsThemOnceItIsConfirmed) {
  const auto image = scene().render(Scene::pose(5), 105);
  const PlaceView view = describe_image(image->view());
  const auto ask = [&](const ConfirmOptions& options) { return ask_second_keyframe(view, options); };
  const auto explains = [](const Confirmation& said) {
    return std::ranges::includes(said.explained, said.found, {}, &ExplainedCorner::corner);
  };
  ConfirmOptions options = few_agree().confirm;
  const Confirmation clear = ask(options);
  ASSERT_TRUE(clear.confirmed) << clear.reason;
  EXPECT_TRUE(explains(clear));
  options.by_few.evidence = kNever;
  const Confirmation refused = ask(options);
  ASSERT_FALSE(refused.confirmed);
  ASSERT_EQ(refused.found, clear.found);
  EXPECT_EQ(refused.explained.size(), static_cast<size_t>(refused.supported));
  options.by_image.evidence = kNever;
  options.by_points.evidence = kNever;
  options.by_extent.similarity = kNever;
  options.enough_agreeing = options.min_agreeing;
  const Confirmation rival = ask(options);
  ASSERT_FALSE(rival.confirmed);
  EXPECT_TRUE(explains(rival)) << "enough agree";
}

TEST_F(RelocalizerTest, NeighboursOfAKeyframeWithWhichAFewCornersAgreeAreTried) {
  const auto image = scene().render(Scene::pose(3), 103);
  const PlaceView view = describe_image(image->view());
  // As if a few corners agreed, and nothing spoke for it: nothing is confirmed.
  RelocOptions options = few_agree();
  options.confirm.by_few.evidence = kNever;
  options.shortlist = 1;
  const auto tried = [&](bool shares, const RelocOptions& how) {
    const ExactMap map(4, {{.scene = &scene(), .steps = {0, 2, 4, 6}, .shares = shares}});
    PlaceIndex index;
    index.put(map.index());
    const RelocalizationAnswer answer = relocalize(index, *scene().camera(), view, how);
    EXPECT_EQ(answer.verdict, RelocalizationVerdict::kNotKnown);
    return answer.reason.substr(0, answer.reason.find(" keyframes"));
  };
  EXPECT_EQ(tried(true, options), "none of the 4");
  EXPECT_EQ(tried(false, options), "none of the 1") << "they have nothing in common";
  options.confirm.enough_agreeing = 1;
  options.confirm.by_image.evidence = kNever;
  options.confirm.by_points.evidence = kNever;
  options.confirm.by_extent.similarity = kNever;
  EXPECT_EQ(tried(true, options), "none of the 1") << "enough agree to tell that it is not there";
}

TEST_F(RelocalizerTest, OnlyWhatIsInScopeIsSearched) {
  const auto view_of = [](const Scene& scene) {
    return describe_image(scene.render(Scene::pose(5), 105)->view());
  };
  const MapId here = map().snapshot()->map;
  const MapId there = places_->other_map.snapshot()->map;
  const auto ask = [&](const Scene& scene, const SearchScope& scope, const RelocOptions& options = {}) {
    return relocalize(index_, *scene.camera(), view_of(scene), options, scope);
  };
  const RelocalizationAnswer clear = ask(scene(), {.first = {here}});
  ASSERT_EQ(clear.verdict, RelocalizationVerdict::kConfirmed) << clear.reason;
  for (const PlaceCandidate& c : clear.candidates) EXPECT_EQ(c.map, here) << "clear: no other is tried";
  const RelocalizationAnswer other = ask(places_->other_scene, {.first = {here}});
  ASSERT_EQ(other.verdict, RelocalizationVerdict::kConfirmed) << "the others follow";
  EXPECT_EQ(other.candidates.front().map, there);
  EXPECT_LE(other.candidates.size(), static_cast<size_t>(RelocOptions{}.shortlist));

  const auto within = [](std::vector<MapId> maps) { return SearchScope{.maps = MapSet(std::move(maps))}; };
  EXPECT_EQ(ask(scene(), within({here})).verdict, RelocalizationVerdict::kConfirmed);
  EXPECT_EQ(ask(places_->other_scene, within({here})).verdict, RelocalizationVerdict::kNotKnown);
  EXPECT_EQ(ask(places_->other_scene, within({there, here})).candidates.front().map, there);
  EXPECT_EQ(ask(scene(), within({MapId{{77}}})).verdict, RelocalizationVerdict::kNotKnown)
      << "a map that has gone";
  const RelocalizationAnswer first_is_out = ask(places_->other_scene, {MapSet({here}), {there}});
  EXPECT_EQ(first_is_out.verdict, RelocalizationVerdict::kNotKnown)
      << "what is first must be in the set all the same";
  EXPECT_EQ(ask(scene(), {MapSet({here}), {there}}).verdict, RelocalizationVerdict::kConfirmed);
  RelocOptions paper;
  paper.method = RelocMethod::kPaper;
  EXPECT_EQ(ask(places_->other_scene, within({here}), paper).candidates.front().map, here);
  EXPECT_EQ(ask(places_->other_scene, {.first = {here}}, paper).candidates.front().map, there);
}

TEST_F(RelocalizerTest, TheEmptyScopeIsNoMap) {
  const PlaceView view = describe_image(scene().render(Scene::pose(5), 105)->view());
  RelocOptions paper;
  paper.method = RelocMethod::kPaper;
  for (const RelocOptions& options : {RelocOptions{}, paper}) {
    const RelocalizationAnswer answer =
        relocalize(index_, *scene().camera(), view, options, {.maps = MapSet(std::vector<MapId>())});
    EXPECT_EQ(answer.verdict, RelocalizationVerdict::kNotKnown);
    EXPECT_TRUE(answer.candidates.empty());
  }
}

TEST_F(RelocalizerTest, LightDoesNotMatter) {
  const auto image = scene().render(Scene::pose(2), 5);
  for (const auto& [gain, bias, gamma] :
       {std::tuple(0.5, 0.0, 1.0), std::tuple(0.7, 70.0, 1.0), std::tuple(1.4, -20.0, 1.0),
        std::tuple(2.0, 0.0, 1.0), std::tuple(1.0, 0.0, 0.5), std::tuple(1.0, 0.0, 2.0)}) {
    SCOPED_TRACE(::testing::Message() << gain << " " << bias << " " << gamma);
    GrayImage lit(image->view());
    for (int y = 0; y < lit.height(); ++y) {
      for (int x = 0; x < lit.width(); ++x) {
        const double curved = 255 * std::pow(lit.row(y)[x] / 255.0, gamma);
        lit.row(y)[x] = static_cast<uint8_t>(std::clamp(std::lround(gain * curved + bias), 0L, 255L));
      }
    }
    const RelocalizationAnswer answer =
        relocalize(index_, *scene().camera(), describe_image(lit), RelocOptions());
    ASSERT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << answer.reason;
    EXPECT_LT(error_of(camera_of(answer, *map().snapshot()), Scene::pose(2), *map().snapshot()), 0.01);
  }
}

TEST_F(RelocalizerTest, AnEmptyIndexAndAnEmptyImageKnowNothing) {
  const auto image = scene().render(Scene::pose(2), 5);
  const PlaceView view = describe_image(image->view());
  EXPECT_EQ(relocalize({}, *scene().camera(), view, RelocOptions()).verdict,
            RelocalizationVerdict::kNotKnown);
  EXPECT_EQ(relocalize(index_, *scene().camera(), {}, RelocOptions()).verdict,
            RelocalizationVerdict::kNotKnown);
  PlaceView blank = describe_image(GrayImage(image->width(), image->height()));
  EXPECT_TRUE(blank.corners.empty());
  EXPECT_EQ(relocalize(index_, *scene().camera(), blank, RelocOptions()).verdict,
            RelocalizationVerdict::kNotKnown);
}

TEST_F(RelocalizerTest, ThePaperAnswersWithTheNearestKeyframeWhateverItIs) {
  RelocOptions paper;
  paper.method = RelocMethod::kPaper;
  const auto image = scene().render(Scene::pose(4), 5);
  const RelocalizationAnswer answer =
      relocalize(index_, *scene().camera(), describe_image(image->view()), paper);
  ASSERT_EQ(answer.verdict, RelocalizationVerdict::kUnconfirmed);
  ASSERT_EQ(answer.candidates.size(), 1U);
  EXPECT_EQ(answer.candidates.front().map, map().snapshot()->map);
  EXPECT_EQ(answer.candidates.front().keyframe, KeyframeId{2});
  EXPECT_LT(error_of(camera_of(answer, *map().snapshot()), Scene::pose(4), *map().snapshot()), 0.02);
  const auto elsewhere = Scene(13).render(Scene::pose(0), 1);
  EXPECT_EQ(relocalize(index_, *scene().camera(), describe_image(elsewhere->view()), paper).verdict,
            RelocalizationVerdict::kUnconfirmed);
}

TEST_F(RelocalizerTest, EqualQueriesHaveEqualAnswers) {
  const auto image = scene().render(Scene::pose(3), 5);
  const PlaceView view = describe_image(image->view());
  const RelocalizationAnswer first = relocalize(index_, *scene().camera(), view, RelocOptions());
  const RelocalizationAnswer second = relocalize(index_, *scene().camera(), view, RelocOptions());
  ASSERT_EQ(first.candidates.size(), second.candidates.size());
  for (size_t i = 0; i < first.candidates.size(); ++i) {
    const SE3& a = first.candidates[i].camera_from_keyframe;
    const SE3& b = second.candidates[i].camera_from_keyframe;
    EXPECT_EQ(a.translation(), b.translation());
    EXPECT_EQ(a.rotation().coeffs(), b.rotation().coeffs());
    EXPECT_EQ(first.candidates[i].keyframe, second.candidates[i].keyframe);
  }
}

TEST_F(RelocalizerTest, TheOrderInWhichMapsCameDoesNotMatter) {
  PlaceIndex other_order;
  other_order.put(places_->other_map.index());
  other_order.put(map().index());
  for (const int step : {1, 5, 9}) {
    const PlaceView view = describe_image(scene().render(Scene::pose(step), 3)->view());
    const auto cells = probed_cells(view);
    const auto votes = vote(index_, all_maps(index_), view, cells, 6, VoteOptions());
    const auto same = vote(other_order, all_maps(other_order), view, cells, 6, VoteOptions());
    ASSERT_EQ(votes.size(), 6U);
    for (size_t i = 0; i < votes.size(); ++i) {
      EXPECT_EQ(votes[i].score, same[i].score);
      EXPECT_EQ(votes[i].keyframe, same[i].keyframe);
      EXPECT_EQ(votes[i].map->snapshot->map, same[i].map->snapshot->map);
    }
    const RelocalizationAnswer first = relocalize(index_, *scene().camera(), view, RelocOptions());
    const RelocalizationAnswer second = relocalize(other_order, *scene().camera(), view, RelocOptions());
    ASSERT_EQ(first.candidates.size(), second.candidates.size());
    EXPECT_EQ(first.candidates.front().camera_from_keyframe.translation(),
              second.candidates.front().camera_from_keyframe.translation());
  }
}

TEST_F(RelocalizerTest, ThePrefilterTellsWhetherToLookCloser) {
  const PlaceView view = describe_image(scene().render(Scene::pose(5), 105)->view());
  const auto cells = probed_cells(view);
  const CornerGrid grid(view, *scene().camera());
  size_t promising_at_its_place = 0;
  size_t done_with = 0;
  for (const IndexedMapPtr& indexed : index_.maps()) {
    for (size_t k = 0; k < indexed->keyframes.size(); ++k) {
      const Prefilter prefilter = run_prefilter(view, cells, *indexed, k, MatchOptions());
      EXPECT_TRUE(
          std::ranges::all_of(prefilter.matches, [](const PlaceMatch& m) { return m.corner % 2 == 0; }));
      EXPECT_LE(prefilter.distinct, prefilter.matches.size());
      const auto all = match_closer(view, cells, *indexed, k, prefilter, MatchOptions());
      if (prefilter.supported > 0) {
        promising_at_its_place += indexed->snapshot->map == map().snapshot()->map ? 1 : 0;
        continue;
      }
      ++done_with;
      EXPECT_LT(keep_supported(view, all, MatchOptions()).size(),
                static_cast<size_t>(ConfirmOptions{}.min_supported));
      const Confirmation said = confirm(view, cells, grid, *scene().camera(), *indexed, k, prefilter, {});
      EXPECT_FALSE(said.confirmed);
      EXPECT_EQ(said.matches, static_cast<int>(prefilter.distinct)) << "no closer look";
    }
  }
  EXPECT_EQ(promising_at_its_place, 3U);
  EXPECT_GT(done_with, 0U);
}

/// The corners of a place with the image of another: a pose is found, and what is seen at the points by it
/// is something else.
TEST_F(RelocalizerTest, APoseByWhichTheImageIsNotSimilarIsNotRefined) {
  const auto image = scene().render(Scene::pose(5), 105);
  PlaceView view = describe_image(image->view());
  const auto ask = [&](const ConfirmOptions& options) { return ask_second_keyframe(view, options); };
  ConfirmOptions options;
  options.by_extent.agreeing_cells = kImageCells + 1;  // as if they lay in a few parts
  ASSERT_TRUE(ask(options).confirmed);
  std::vector<size_t> all_cells(kImageCells);
  std::iota(all_cells.begin(), all_cells.end(), 0);
  view.small = with_inconsistent_cells(GrayImage(view.small.view()).view(), all_cells);
  const Confirmation said = ask(options);
  EXPECT_FALSE(said.confirmed);
  EXPECT_EQ(said.inliers, 0) << "not refined";
  EXPECT_TRUE(said.similarity < options.least_similarity || evidence(said) < options.least_evidence);
  EXPECT_GE(said.agreeing, options.enough_agreeing);
  EXPECT_GE(said.explained.size(), static_cast<size_t>(said.agreeing)) << "as a rival it explains them";
  EXPECT_GT(ask({}).inliers, 0) << "corners agree all about the image: a part may have moved";
  options.least_similarity = -kNever;
  options.least_evidence = -kNever;
  EXPECT_GT(ask(options).inliers, 0);
}

}  // namespace
}  // namespace cairn
