"""Learners of features, and a classifier, with scikit-learn's protocol. scikit-learn is needed: ``pip install scikit-learn``.

They are those of the tracker (docs/paper.md has their equations), and know nothing of tracking. All take arrays of shape
(n_samples, n_features) and compute in float32; the same ``random_state`` gives the same bits, whatever the number of threads, and the
interpreter's lock is free while they learn.

>>> from sklearn.datasets import load_digits
>>> from sklearn.pipeline import make_pipeline
>>> digits, labels = load_digits(return_X_y=True)
>>> model = make_pipeline(SphericalKMeans(100, threshold=0.5, explained_variance=0.99, random_state=0), SoftmaxRegression(C=0.1))
>>> model.fit(digits[:1000], labels[:1000]).score(digits[1000:], labels[1000:]) > 0.9
True
"""

from ._filters import SphericalKMeans
from ._rbm import RBM
from ._softmax import SoftmaxRegression

__all__ = ["RBM", "SoftmaxRegression", "SphericalKMeans"]
