#include "phri_learning/displacement_regression.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "phri_core/check.hpp"
#include "phri_learning/hmm_training.hpp"

namespace phri_learning
{
namespace
{
constexpr std::array<double, 3> kLags = { 0.02, 0.06, 0.16 };         // [s]
constexpr double kBaseRidge = 1e-5;                                   // of the mean squared regressor
constexpr std::array<double, 4> kRidges = { 0.002, 0.02, 0.2, 2.0 };  // of a feature's variance in the state
constexpr std::array<double, 2> kPriors = { 0.04, 0.4 };  // [s] of data that say the local model is the base
constexpr double kPooled = 0.2;                           // [s] of data that say a state's errors are everybody's
constexpr double kFloor = 1e-4;                           // smallest standard deviation, of the block's own size
constexpr double kSingle = 4.0;                           // widening for one demonstration, which cannot be left out
constexpr double kIrrelevant = 1e-3;                      // state probability

/// One sample of one demonstration and what came of it.
struct Row
{
  Eigen::VectorXd phi;     // (q), later centred and scaled
  Eigen::MatrixXd basis;   // (d, 5)
  Eigen::VectorXd states;  // (S)
};
using Rows = std::vector<std::vector<Row>>;
using Stats = std::vector<Eigen::MatrixXd>;  // per state: sum g [1; phi; r] [1; phi; r]'

struct Ridge
{
  double feature = kRidges.back(), prior = kPriors.back();
};

void validate(const std::vector<Eigen::MatrixXd>& demonstrations, const DisplacementOptions& o, int steps)
{
  if (demonstrations.empty())
    throw std::invalid_argument("demonstrations: none given, expected at least one");
  Eigen::Index longest = 0;
  for (std::size_t e = 0; e < demonstrations.size(); ++e)
  {
    const Eigen::MatrixXd& y = demonstrations[e];
    const std::string name = "demonstration " + std::to_string(e);
    if (y.rows() < 1 || y.cols() != demonstrations[0].cols() || y.cols() < o.axes || y.cols() % o.axes != 0)
      throw std::invalid_argument(name + " has shape (" + std::to_string(y.rows()) + ", " + std::to_string(y.cols()) +
                                  "), expected (1 or more, a multiple of " + std::to_string(o.axes) +
                                  " axes, the same for all)");
    phri_core::requireFinite(name, y);
    longest = std::max(longest, y.rows());
  }
  if (longest < steps + 2)
    throw std::invalid_argument("the longest demonstration has " + std::to_string(longest) +
                                " samples, expected at least " + std::to_string(steps + 2) + " for a horizon of " +
                                std::to_string(steps));
}

std::shared_ptr<const TimeHmm> recogniserOf(const std::vector<Eigen::MatrixXd>& demonstrations,
                                            const DisplacementOptions& o, const DisplacementRegression& r)
{
  std::vector<Eigen::MatrixXd> motions;
  double samples = 0.0;
  for (const Eigen::MatrixXd& y : demonstrations)
  {
    SampleHistory history(r.axes, r.dimension, r.dt, r.lags);
    Eigen::MatrixXd motion(y.rows(), 2 * o.axes);
    Eigen::VectorXd row(2 * o.axes);
    for (Eigen::Index t = 0; t < y.rows(); ++t)
    {
      t == 0 ? history.start(y.row(t).transpose()) : history.push(y.row(t).transpose());
      history.motion(row);
      motion.row(t) = row;
    }
    samples += static_cast<double>(y.rows()) / static_cast<double>(demonstrations.size());
    motions.push_back(std::move(motion));
  }
  TrainingOptions training;
  training.dt = o.dt;
  training.states = o.states > 0 ? o.states : static_cast<int>(std::lround(std::clamp(samples / r.steps, 10.0, 40.0)));
  return std::make_shared<const TimeHmm>(train(motions, training).model);
}

Rows rowsOf(const std::vector<Eigen::MatrixXd>& demonstrations, const DisplacementRegression& r)
{
  Rows all;
  Eigen::VectorXd motion(2 * r.axes);
  for (const Eigen::MatrixXd& y : demonstrations)
  {
    SampleHistory history(r.axes, r.dimension, r.dt, r.lags);
    StateFilter filter(r.recogniser);
    std::vector<Row> rows(static_cast<std::size_t>(y.rows()));
    for (Eigen::Index t = 0; t < y.rows(); ++t)
    {
      t == 0 ? history.start(y.row(t).transpose()) : history.push(y.row(t).transpose());
      Row& row = rows[static_cast<std::size_t>(t)];
      row.phi.resize(r.features());
      history.features(row.phi);
      row.basis.resize(r.dimension, 5);
      for (int j = 0; j < r.dimension; ++j)
        for (int c = 0; c < 5; ++c)
          row.basis(j, c) = history.basis(j / r.axes, j % r.axes, c);
      history.motion(motion);
      filter.observe(motion);
      row.states = filter.probability();
    }
    all.push_back(std::move(rows));
  }
  return all;
}

/// Centre and size of phi: one size for all axes of a block, so that no direction is preferred.
void standardise(Rows* rows, DisplacementRegression* r)
{
  const int q = r->features(), n = r->axes;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(q), square = sum;
  double count = 0.0;
  for (const auto& demonstration : *rows)
    for (const Row& row : demonstration)
    {
      sum += row.phi;
      count += 1.0;
    }
  r->center = sum / count;
  for (const auto& demonstration : *rows)
    for (const Row& row : demonstration)
      square += (row.phi - r->center).cwiseAbs2();
  r->scale.resize(q);
  for (int j = 0; j < q; j += n)
  {
    const double size = std::sqrt(square.segment(j, n).sum() / (n * count));
    r->scale.segment(j, n).setConstant(size > 1e-12 * (1.0 + r->center.segment(j, n).cwiseAbs().maxCoeff()) ? size
                                                                                                            : 1.0);
  }
  for (auto& demonstration : *rows)
    for (Row& row : demonstration)
      row.phi = (row.phi - r->center).cwiseQuotient(r->scale);
}

/// Weights of the base k samples ahead, (blocks, 5).
Eigen::MatrixXd fitBase(const std::vector<Eigen::MatrixXd>& demonstrations, const Rows& rows,
                        const DisplacementRegression& r, int k)
{
  Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(r.blocks(), 5);
  for (int b = 0; b < r.blocks(); ++b)
  {
    const int columns = b == 0 ? 3 : 5;
    Eigen::VectorXd size(columns), prior = Eigen::VectorXd::Zero(columns);
    size.setConstant(r.scale(3 * r.axes));
    if (b == 0)
      prior.head(2) << 0.5 * k / r.lags[0], 0.5 * k / r.lags[1];
    else
      size.tail(2).setConstant(r.scale((3 + b) * r.axes));
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(columns, columns);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(columns);
    for (std::size_t e = 0; e < rows.size(); ++e)
      for (Eigen::Index t = 1; t + k < demonstrations[e].rows(); ++t)
        for (int j = b * r.axes; j < (b + 1) * r.axes; ++j)
        {
          const auto basis = rows[e][static_cast<std::size_t>(t)].basis.row(j).head(columns).transpose();
          const double missed = demonstrations[e](t + k, j) - demonstrations[e](t, j) - basis.dot(prior);
          const Eigen::VectorXd scaled = basis.cwiseQuotient(size);
          normal += scaled * scaled.transpose();
          right += scaled * missed;
        }
    normal.diagonal().array() += kBaseRidge * normal.trace() / columns + std::numeric_limits<double>::min();
    weights.row(b).head(columns) = prior + normal.ldlt().solve(right).cwiseQuotient(size);
  }
  return weights;
}

std::vector<Stats> statistics(const std::vector<Eigen::MatrixXd>& demonstrations, const Rows& rows,
                              const DisplacementRegression& r, int k)
{
  const int q = r.features(), d = r.dimension;
  const Eigen::MatrixXd& base = r.base[static_cast<std::size_t>(k - 1)];
  std::vector<Stats> all(rows.size(),
                         Stats(static_cast<std::size_t>(r.states()), Eigen::MatrixXd::Zero(1 + q + d, 1 + q + d)));
  Eigen::VectorXd z(1 + q + d);
  for (std::size_t e = 0; e < rows.size(); ++e)
    for (Eigen::Index t = 1; t + k < demonstrations[e].rows(); ++t)
    {
      const Row& row = rows[e][static_cast<std::size_t>(t)];
      z(0) = 1.0;
      z.segment(1, q) = row.phi;
      for (int j = 0; j < d; ++j)
        z(1 + q + j) =
            demonstrations[e](t + k, j) - demonstrations[e](t, j) - row.basis.row(j).dot(base.row(j / r.axes));
      for (int i = 0; i < r.states(); ++i)
        if (row.states(i) > kIrrelevant)
          all[e][static_cast<std::size_t>(i)].selfadjointView<Eigen::Lower>().rankUpdate(z, row.states(i));
    }
  for (Stats& stats : all)
    for (Eigen::MatrixXd& m : stats)
      m.triangularView<Eigen::StrictlyUpper>() = m.transpose();
  return all;
}

/// [b - B phi_i, B] of the rows [first, first + count) of r, (count, 1 + q).
Eigen::MatrixXd solve(const Eigen::MatrixXd& stats, int q, int first, int count, const Ridge& ridge, double dt)
{
  const double n = stats(0, 0);
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(count, 1 + q);
  if (n < 1e-6)
    return result;
  const Eigen::VectorXd mean = stats.col(0).segment(1, q) / n, missed = stats.col(0).segment(1 + q + first, count) / n;
  Eigen::MatrixXd within = stats.block(1, 1, q, q) / n - mean * mean.transpose();
  const Eigen::MatrixXd cross = stats.block(1, 1 + q + first, q, count) / n - mean * missed.transpose();
  const double typical = std::max(within.trace() / q, 0.0);
  within.diagonal() += ridge.feature * (within.diagonal().cwiseMax(0.0).array() + 0.01 * typical + 1e-6).matrix();
  const double trust = n / (n + ridge.prior / dt);
  result.rightCols(q) = trust * within.ldlt().solve(cross).transpose();
  result.col(0) = trust * missed - result.rightCols(q) * mean;
  return result;
}

/// sum g (r - local)(r - local)' over the samples of `stats`.
Eigen::MatrixXd errors(const Eigen::MatrixXd& stats, int q, const Eigen::MatrixXd& local)
{
  const Eigen::Index d = local.rows();
  const Eigen::MatrixXd cross = local * stats.block(0, 1 + q, 1 + q, d);
  return stats.bottomRightCorner(d, d) - cross - cross.transpose() +
         local * stats.topLeftCorner(1 + q, 1 + q) * local.transpose();
}

Eigen::MatrixXd solveBlocks(const Eigen::MatrixXd& stats, const DisplacementRegression& r,
                            const std::vector<Ridge>& ridges)
{
  Eigen::MatrixXd local(r.dimension, 1 + r.features());
  for (int b = 0; b < r.blocks(); ++b)
    local.middleRows(b * r.axes, r.axes) =
        solve(stats, r.features(), b * r.axes, r.axes, ridges[static_cast<std::size_t>(b)], r.dt);
  return local;
}

Stats total(const std::vector<Stats>& all)
{
  Stats sum = all[0];
  for (std::size_t e = 1; e < all.size(); ++e)
    for (std::size_t i = 0; i < sum.size(); ++i)
      sum[i] += all[e][i];
  return sum;
}

/// For each block the ridge with the least squared error on left-out demonstrations, at the farthest horizon.
std::vector<Ridge> chooseRidges(const std::vector<Stats>& all, const DisplacementRegression& r)
{
  std::vector<Ridge> best(static_cast<std::size_t>(r.blocks()));
  if (all.size() < 2)
    return best;
  const Stats sum = total(all);
  Eigen::VectorXd least = Eigen::VectorXd::Constant(r.blocks(), std::numeric_limits<double>::infinity());
  for (const double feature : kRidges)
    for (const double prior : kPriors)
    {
      Eigen::VectorXd cost = Eigen::VectorXd::Zero(r.blocks());
      const std::vector<Ridge> ridges(best.size(), Ridge{ feature, prior });
      for (const Stats& left_out : all)
        for (std::size_t i = 0; i < sum.size(); ++i)
          if (left_out[i](0, 0) > 0.0)
          {
            const Eigen::MatrixXd e = errors(left_out[i], r.features(), solveBlocks(sum[i] - left_out[i], r, ridges));
            for (int b = 0; b < r.blocks(); ++b)
              cost(b) += e.diagonal().segment(b * r.axes, r.axes).sum();
          }
      for (int b = 0; b < r.blocks(); ++b)
        if (cost(b) < least(b))
        {
          least(b) = cost(b);
          best[static_cast<std::size_t>(b)] = ridges[0];
        }
    }
  return best;
}

double logDeterminant(const Eigen::MatrixXd& covariance)
{
  return 2.0 * covariance.llt().matrixL().toDenseMatrix().diagonal().array().log().sum();
}

void fitLocal(const std::vector<Stats>& all, const std::vector<Ridge>& ridges, DisplacementRegression* r)
{
  const int q = r->features(), d = r->dimension;
  const std::size_t states = all[0].size();
  const Stats sum = total(all);
  Stats missed(states, Eigen::MatrixXd::Zero(d, d));
  Eigen::MatrixXd pooled = Eigen::MatrixXd::Zero(d, d), pooled_base = pooled;
  double count = 0.0;
  for (std::size_t i = 0; i < states; ++i)
  {
    r->local.push_back(solveBlocks(sum[i], *r, ridges));
    for (const Stats& one : all)
      missed[i] += errors(one[i], q, all.size() > 1 ? solveBlocks(sum[i] - one[i], *r, ridges) : r->local.back());
    pooled += missed[i];
    pooled_base += sum[i].bottomRightCorner(d, d);
    count += sum[i](0, 0);
  }
  const double e = static_cast<double>(all.size()), widening = all.size() > 1 ? e / (e - 1.0) : kSingle;
  const double prior = kPooled / r->dt;
  Eigen::VectorXd least(d);
  for (int j = 0; j < d; ++j)
    least(j) = std::pow(kFloor * r->scale(j < r->axes ? j : 3 * r->axes + j), 2);
  const auto proper = [&](const Eigen::MatrixXd& errors, const Eigen::MatrixXd& everywhere, double n) {
    Eigen::MatrixXd c = widening * (errors + prior / count * everywhere) / (n + prior);
    c = 0.5 * (c + c.transpose()).eval();
    c.diagonal() += least;
    return c;
  };
  for (std::size_t i = 0; i < states; ++i)
  {
    const double n = sum[i](0, 0);
    r->local_covariance.push_back(proper(missed[i], pooled, n));
    r->base_covariance.push_back(proper(sum[i].bottomRightCorner(d, d), pooled_base, n));
    r->evidence.push_back(0.5 * (logDeterminant(r->base_covariance.back().topLeftCorner(r->axes, r->axes)) -
                                 logDeterminant(r->local_covariance.back().topLeftCorner(r->axes, r->axes))));
  }
}
}  // namespace

DisplacementRegression trainDisplacements(const std::vector<Eigen::MatrixXd>& demonstrations,
                                          const DisplacementOptions& options, std::shared_ptr<const TimeHmm> recogniser)
{
  phri_core::requireRange("axes", options.axes, 1, 6, "");
  phri_core::requireRange("dt", options.dt, 1e-6, 1e3, "s");
  phri_core::requireRange("horizon", options.horizon, options.dt, 1e4 * options.dt, "s");
  phri_core::requireRange("states", options.states, 0, 1e4, "");
  DisplacementRegression r;
  r.steps = static_cast<int>(std::lround(options.horizon / options.dt));
  validate(demonstrations, options, r.steps);
  r.dt = options.dt;
  r.axes = options.axes;
  r.dimension = static_cast<int>(demonstrations[0].cols());
  r.demonstrations = static_cast<int>(demonstrations.size());
  for (std::size_t l = 0; l < 3; ++l)
    r.lags[l] = std::max(l > 0 ? r.lags[l - 1] + 1 : 1, static_cast<int>(std::lround(kLags[l] / r.dt)));
  r.recogniser = recogniser ? std::move(recogniser) : recogniserOf(demonstrations, options, r);
  if (r.recogniser->dimension() != 2 * r.axes || std::abs(r.recogniser->dt() - r.dt) > 1e-9 * r.dt)
    throw std::invalid_argument("recogniser has " + std::to_string(r.recogniser->dimension()) + " dimensions and dt " +
                                std::to_string(r.recogniser->dt()) + " s, expected " + std::to_string(2 * r.axes) +
                                " ([p; v]) and " + std::to_string(r.dt) + " s");
  Rows rows = rowsOf(demonstrations, r);
  standardise(&rows, &r);
  for (int k = 1; k <= r.steps; ++k)
    r.base.push_back(fitBase(demonstrations, rows, r, k));
  const std::vector<Ridge> ridges = chooseRidges(statistics(demonstrations, rows, r, r.steps), r);
  for (int k = 1; k <= r.steps; ++k)
    fitLocal(statistics(demonstrations, rows, r, k), ridges, &r);
  return r;
}
}  // namespace phri_learning
