#pragma once
/// One stage of multiplicative_noise.hpp: a quadratic function V of the next state, seen from z = (xi, u) before the
/// stage, for x+ = M z + d + sum_j (G_j z + e_j) w_j, w ~ N(0, I), M = [A B]. With c_j = G_j z + e_j, E = [c_1 ..],
/// y = M z + d, g = W y + w (gradient of V at y), a = E'g, P = E'WE, V as a function of w is V(y) + a'w + 1/2 w'P w, so
///
///   E V = V(y) + 1/2 tr P                                                           quadratic in z: exact
///   Var V = a'a + 1/2 tr(P P)                                                       quartic in z
///   h = theta^-1 log E exp(theta V) = V(y) + 1/2 a'beta - 1/(2 theta) log det F,    F = I - theta P,
///       beta = theta F^-1 a                                                         finite if and only if F(z) > 0
///
/// The last two are replaced by their Taylor polynomials of second order at an expansion point zb. With
/// v(z, w) = V(x+), Isserlis' theorem gives their exact derivatives from those of v:
///
///   dVar = 2 Cov[v, dv],      d2Var = 2 Cov[dv, dv] + 2 Cov[v, d2v]                 under w ~ N(0, I)
///   dh = E[dv],               d2h = E[d2v] + theta Cov[dv, dv]                      under w ~ N(beta, F^-1)
///
/// where dv = (M + G w)'(g + W E w) and d2v = (M + G w)'W (M + G w), G w = sum_j G_j w_j. The tilted measure is brought
/// back to N(0, I) by M += G beta, g += W E beta and channels times C^-T, F = C C'. Then, R_j = G_j'g + M'W c_j,
/// N_ij = G_i'W c_j + G_j'W c_i,
///
///   E[dv] = M'g + sum_j G_j'W c_j,                   E[d2v] = M'W M + sum_j G_j'W G_j
///   Cov[dv, dv] = sum_j R_j R_j' + 1/2 sum_ij N_ij N_ij',    Cov[v, dv] = sum_j a_j R_j + 1/2 sum_ij P_ij N_ij
///   Cov[v, d2v] = sum_j a_j (G_j'W M + M'W G_j) + sum_ij P_ij G_i'W G_j
///
/// G = 0 makes all of it exact: the formulas of risk_evaluation.hpp and cumulant_evaluation.hpp.

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "phri_control/risk_evaluation.hpp"

namespace phri_control::detail
{
template <int N, int M>
constexpr int kJoint = N == Eigen::Dynamic || M == Eigen::Dynamic ? Eigen::Dynamic : N + M;

/// 1/2 z'H z + h'z + c, z = (xi, u).
template <int Z>
struct StageQuadratic
{
  Eigen::Matrix<double, Z, Z> H;
  Eigen::Matrix<double, Z, 1> h;
  double c = 0.0;

  /// From coefficients about `center` to those about 0.
  void recenter(const Eigen::Matrix<double, Z, 1>& center)
  {
    const Eigen::Matrix<double, Z, 1> Hz = H.lazyProduct(center);
    c += center.dot(0.5 * Hz - h);
    h -= Hz;
  }
};

/// What a stage needs within one group of channels, kept so that the next solve allocates nothing.
template <int N, int M>
struct ChannelScratch
{
  static constexpr int Z = kJoint<N, M>;
  std::vector<Eigen::Matrix<double, N, Z>> G, WG;  // per channel
  Eigen::MatrixXd c, Wc;                           // (n, p)
  Eigen::Matrix<double, Z, Eigen::Dynamic> R;
  Eigen::MatrixXd P, F;
  Eigen::VectorXd a, beta;
  Eigen::Matrix<double, N, Z> joint, Wjoint;  // M, W M
  Eigen::Matrix<double, N, 1> y, g;
  Eigen::Matrix<double, Z, 1> center, slope;  // zb

  void resize(Eigen::Index n, Eigen::Index m, Eigen::Index p)
  {
    G.resize(p);
    WG.resize(p);
    c.resize(n, p);
    Wc.resize(n, p);
    R.resize(n + m, p);
    P.resize(p, p);
    F.resize(p, p);
    a.resize(p);
    beta.resize(p);
    joint.resize(n, n + m);
    center.resize(n + m);
  }
};

/// g, a, P and the products with W at the expansion point.
template <int N, int M>
void expandAt(const QuadraticValue<N>& V, ChannelScratch<N, M>& s)
{
  s.g = V.w;
  s.g.noalias() += V.W.lazyProduct(s.y);
  s.Wjoint = V.W.lazyProduct(s.joint);
  s.Wc.noalias() = V.W.lazyProduct(s.c);
  s.P.noalias() = s.c.transpose().lazyProduct(s.Wc);
  s.a.noalias() = s.c.transpose().lazyProduct(s.g);
  for (std::size_t j = 0; j < s.G.size(); ++j)
    s.WG[j] = V.W.lazyProduct(s.G[j]);
}

/// To the measure N(beta, F^-1) of w and back to N(0, I) of its standardised components. Returns false unless F > 0,
/// with G, c, M, g as they were; `constant` gains the noise's part of h. The pivots of F are 1 - theta s_i, where s_i
/// is what the earlier channels have made of P_ii: that keeps the digits where theta is small.
template <int N, int M>
bool tilt(double theta, ChannelScratch<N, M>& s, double& constant)
{
  const Eigen::Index p = s.P.rows();
  for (Eigen::Index i = 0; i < p; ++i)
  {
    const double x = theta * s.P(i, i), pivot = 1.0 - x;
    if (!(pivot > 0.0))
      return false;
    constant += 0.5 * s.P(i, i) * (x == 0.0 ? 1.0 : -std::log1p(-x) / x);
    s.F(i, i) = std::sqrt(pivot);
    for (Eigen::Index j = i + 1; j < p; ++j)
      s.F(j, i) = -theta * s.P(j, i) / s.F(i, i);
    for (Eigen::Index j = i + 1; j < p; ++j)
      for (Eigen::Index l = i + 1; l < p; ++l)
        s.P(j, l) += theta / pivot * s.P(j, i) * s.P(i, l);
  }
  s.beta = -theta * s.a;
  solveNegative(s.F, s.beta);
  constant += 0.5 * s.a.dot(s.beta);
  for (Eigen::Index j = 0; j < p; ++j)
  {
    s.joint += s.beta[j] * s.G[j];
    s.Wjoint += s.beta[j] * s.WG[j];
    s.g += s.beta[j] * s.Wc.col(j);
  }
  for (Eigen::Index i = 0; i < p; ++i)
  {
    const double scale = 1.0 / s.F(i, i);
    for (Eigen::Index j = 0; j < i; ++j)
    {
      s.G[i] -= s.F(i, j) * s.G[j];
      s.WG[i] -= s.F(i, j) * s.WG[j];
      s.c.col(i) -= s.F(i, j) * s.c.col(j);
      s.Wc.col(i) -= s.F(i, j) * s.Wc.col(j);
    }
    s.G[i] *= scale;
    s.WG[i] *= scale;
    s.c.col(i) *= scale;
    s.Wc.col(i) *= scale;
  }
  return true;
}

/// H += scale Cov[dv, dv]; R is left in the scratch.
template <int N, int M>
void addGradientCovariance(double scale, ChannelScratch<N, M>& s, Eigen::Matrix<double, kJoint<N, M>, kJoint<N, M>>& H)
{
  for (std::size_t i = 0; i < s.G.size(); ++i)
  {
    auto R = s.R.col(i);
    R.noalias() = s.G[i].transpose().lazyProduct(s.g);
    R.noalias() += s.Wjoint.transpose().lazyProduct(s.c.col(i));
    H.noalias() += R.lazyProduct((scale * R).transpose());
    for (std::size_t j = 0; j <= i; ++j)
    {
      s.slope.noalias() = s.G[i].transpose().lazyProduct(s.Wc.col(j));
      s.slope.noalias() += s.G[j].transpose().lazyProduct(s.Wc.col(i));
      H.noalias() += s.slope.lazyProduct(((i == j ? 0.5 : 1.0) * scale * s.slope).transpose());
    }
  }
}

/// theta^-1 log E exp(theta V) about the expansion point, E V for theta = 0. False, and channels and M as they were,
/// unless it exists; with a theta they are the tilted ones afterwards.
template <int N, int M>
bool expect(double theta, const QuadraticValue<N>& V, ChannelScratch<N, M>& s, StageQuadratic<kJoint<N, M>>& out)
{
  expandAt(V, s);
  out.c = V.c + 0.5 * s.y.dot(V.w + s.g);
  if (theta == 0.0)
    out.c += 0.5 * s.P.trace();
  else if (!tilt(theta, s, out.c))
    return false;
  out.H.noalias() = s.joint.transpose().lazyProduct(s.Wjoint);
  out.h.noalias() = s.joint.transpose().lazyProduct(s.g);
  for (std::size_t j = 0; j < s.G.size(); ++j)
  {
    out.H.noalias() += s.G[j].transpose().lazyProduct(s.WG[j]);
    out.h.noalias() += s.G[j].transpose().lazyProduct(s.Wc.col(j));
  }
  if (theta != 0.0)
    addGradientCovariance(theta, s, out.H);
  return true;
}

/// out += Var V about the expansion point; `expect(0, V, ..)` must have been the last to use the scratch.
template <int N, int M>
void addVariance(ChannelScratch<N, M>& s, StageQuadratic<kJoint<N, M>>& out)
{
  addGradientCovariance(2.0, s, out.H);
  for (std::size_t i = 0; i < s.G.size(); ++i)
  {
    const double a = s.a[i];
    out.c += a * a;
    out.h += 2.0 * a * s.R.col(i);
    out.H.noalias() += (2.0 * a * s.G[i].transpose()).lazyProduct(s.Wjoint);
    out.H.noalias() += (2.0 * a * s.Wjoint.transpose()).lazyProduct(s.G[i]);
    for (std::size_t j = 0; j < s.G.size(); ++j)
    {
      const double P = s.P(i, j);
      out.c += 0.5 * P * P;
      out.h.noalias() += (2.0 * P * s.G[i].transpose()).lazyProduct(s.Wc.col(j));
      out.H.noalias() += (2.0 * P * s.G[i].transpose()).lazyProduct(s.WG[j]);
    }
  }
}

/// Mean and variance of the cost to go through additive noise of this factor: exact.
template <int N>
void throughAdditiveNoise(const Eigen::MatrixXd& factor, QuadraticValue<N>& mean, QuadraticValue<N>& variance)
{
  Eigen::Matrix<double, N, 1> v(factor.rows());
  for (Eigen::Index column = 0; column < factor.cols(); ++column)
  {
    const auto e = factor.col(column);
    v.noalias() = variance.W.lazyProduct(e);
    variance.c += 0.5 * e.dot(v);
    v.noalias() = mean.W.lazyProduct(e);
    const double square = e.dot(v), slope = e.dot(mean.w);
    variance.W.noalias() += v.lazyProduct((2.0 * v).transpose());
    variance.w += 2.0 * slope * v;
    variance.c += slope * slope + 0.5 * square * square;
    mean.c += 0.5 * square;
  }
}

/// The value of z = (xi, L xi + l).
template <int N, int M>
void close(const StageQuadratic<kJoint<N, M>>& stage, const Eigen::Matrix<double, M, N>& L,
           const Eigen::Matrix<double, M, 1>& l, QuadraticValue<N>& value)
{
  const Eigen::Index n = L.cols(), m = L.rows();
  const auto Huu = stage.H.template bottomRightCorner<M, M>(m, m);
  const auto Hux = stage.H.template bottomLeftCorner<M, N>(m, n);
  const auto hu = stage.h.tail(Eigen::fix<M>(m));
  Eigen::Matrix<double, M, N> HL = Huu.lazyProduct(L);
  Eigen::Matrix<double, M, 1> slope = hu;
  value.c = stage.c + l.dot(hu);
  slope.noalias() += Huu.lazyProduct(l);
  value.c += 0.5 * l.dot(slope - hu);
  value.w = stage.h.head(Eigen::fix<N>(n));
  value.w.noalias() += L.transpose().lazyProduct(slope);
  value.w.noalias() += Hux.transpose().lazyProduct(l);
  HL += 2.0 * Hux;
  Eigen::Matrix<double, N, N> W = stage.H.template topLeftCorner<N, N>(n, n);
  W.noalias() += L.transpose().lazyProduct(HL);
  value.W = 0.5 * (W + W.transpose());
}
}  // namespace phri_control::detail
