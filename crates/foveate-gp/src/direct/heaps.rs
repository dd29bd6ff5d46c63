//! Many priority queues over one pool of numbered items: pairing heaps (Fredman et al. 1986), largest value first.
//!
//! An item is in one queue at most. Pushing is one comparison, popping a logarithm of them on average; room is one
//! slot an item, however the items are spread over the queues.

/// No item.
const NONE: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct Node {
    value: f64,
    child: u32,
    sibling: u32,
}

/// The queues.
#[derive(Clone, Debug, Default)]
pub(super) struct Heaps {
    nodes: Vec<Node>,
    roots: Vec<u32>,
}

impl Heaps {
    /// Empties all queues, of which there are `n` from now on; makes room for `items`.
    pub(super) fn clear(&mut self, n: usize, items: usize) {
        self.nodes.clear();
        self.nodes.reserve(items);
        self.roots.clear();
        self.roots.resize(n, NONE);
    }
    /// A new item, in no queue yet; items are numbered from 0. Its value may not be NaN.
    pub(super) fn add(&mut self, value: f64) -> u32 {
        self.nodes.push(Node { value, child: NONE, sibling: NONE });
        (self.nodes.len() - 1) as u32
    }
    /// The value of an item.
    pub(super) fn value(&self, item: u32) -> f64 {
        self.nodes[item as usize].value
    }
    /// The largest value in a queue.
    pub(super) fn top(&self, queue: usize) -> Option<f64> {
        let root = self.roots[queue];
        (root != NONE).then(|| self.value(root))
    }
    /// Puts an item that is in no queue into one.
    pub(super) fn push(&mut self, queue: usize, item: u32) {
        let node = &mut self.nodes[item as usize];
        (node.child, node.sibling) = (NONE, NONE);
        self.roots[queue] = self.meld(self.roots[queue], item);
    }
    /// Takes the item with the largest value out of a queue; of equals, the oldest.
    pub(super) fn pop(&mut self, queue: usize) -> Option<u32> {
        let root = self.roots[queue];
        if root == NONE {
            return None;
        }
        // Meld the children two by two, then all of these, the last first.
        let (mut next, mut pairs) = (self.nodes[root as usize].child, NONE);
        while next != NONE {
            let a = next;
            let b = self.nodes[a as usize].sibling;
            next = if b == NONE { NONE } else { self.nodes[b as usize].sibling };
            let pair = self.meld(a, b);
            self.nodes[pair as usize].sibling = pairs;
            pairs = pair;
        }
        let mut whole = NONE;
        while pairs != NONE {
            let rest = self.nodes[pairs as usize].sibling;
            whole = self.meld(whole, pairs);
            pairs = rest;
        }
        self.roots[queue] = whole;
        Some(root)
    }
    /// Slots for items.
    #[cfg(test)]
    pub(super) fn room(&self) -> usize {
        self.nodes.capacity()
    }
    /// One heap of two.
    fn meld(&mut self, a: u32, b: u32) -> u32 {
        if a == NONE || b == NONE {
            return if a == NONE { b } else { a };
        }
        let (of_a, of_b) = (self.value(a), self.value(b));
        let (over, under) = if of_a > of_b || (of_a == of_b && a < b) { (a, b) } else { (b, a) };
        self.nodes[under as usize].sibling = self.nodes[over as usize].child;
        self.nodes[over as usize].child = under;
        over
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    /// 20,000 random pushes and pops on 5 queues, seed 1, beside sorted lists.
    #[test]
    fn what_comes_out_is_the_largest() {
        let (mut rng, mut heaps, mut lists) = (Streams::new(1, 0).rng(0), Heaps::default(), vec![Vec::new(); 5]);
        heaps.clear(5, 0);
        let mut popped = 0;
        for _ in 0..20_000 {
            let queue = rng.random_range(0..5);
            if rng.random_range(0..5) < 3 {
                let value = f64::from(rng.random_range(0..50u8)); // many ties
                let item = heaps.add(value);
                heaps.push(queue, item);
                lists[queue].push((value, std::cmp::Reverse(item)));
                lists[queue].sort_by(|a: &(f64, _), b| a.partial_cmp(b).expect("numbers"));
            } else {
                let expected = lists[queue].pop();
                assert_eq!(heaps.top(queue), expected.map(|e| e.0));
                assert_eq!(heaps.pop(queue), expected.map(|e| e.1.0));
                popped += 1;
            }
        }
        assert!(popped > 5000);
    }
}
