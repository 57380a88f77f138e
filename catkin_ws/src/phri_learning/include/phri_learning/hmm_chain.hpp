#pragma once
/// Models of movements that follow each other: concatenation (3.13) and the window HMM of section 3.1.2 (Fig. 3.2).

#include "phri_learning/time_hmm.hpp"

namespace phri_learning
{
/// `second` after `first`: S1 + S2 states. The last state of `first` gets a = (d - 1) / d to stay and 1 / d to go on,
/// with its duration d [samples] by the formula of the models (thesis: (3.12), which halves d), within [1e-6, 1 - 1e-6]
/// as in training. Times of `second` are shifted by the length of `first` (needed, not in the text), and its variance
/// between demonstrations grows by that of the end of `first`: the two deviations are taken as independent. scale,
/// repeat_variance, pace_variance and memory are means weighted by length. Associative but for rounding.
/// Throws std::invalid_argument: different dt, dimensions, numbers of components or formulas.
TimeHmm concatenate(const TimeHmm& first, const TimeHmm& second);

struct WindowHmm
{
  TimeHmm model;  ///< times are those of the chain
  int first = 0;  ///< its state i is state first + i of the chain
};

/// `states` states of a chain around state `center`, as many before as after it (of an even number one more after it);
/// moved inwards at the ends of the chain, fewer if it has fewer. It may begin in any of them; its last one is held for
/// ever. Throws std::invalid_argument: center not a state of the chain, states < 1.
WindowHmm windowHmm(const TimeHmm& chain, int center, int states);
}  // namespace phri_learning
